// What every worker in C++ has in common: the protocol of benches/peers/src/worker.rs.
#pragma once
#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

// One input as it lies in the file: joints, seed, and the pose of the joints (rows of [R | t]).
struct Record {
  double joints[6];
  double seed[6];
  double pose[12];
};
static_assert(sizeof(Record) == 24 * sizeof(double));

inline std::vector<Record> read_records(const char *path) {
  std::vector<Record> records;
  std::FILE *file = std::fopen(path, "rb");
  if (!file) {
    std::perror(path);
    std::exit(1);
  }
  Record record;
  while (std::fread(&record, sizeof record, 1, file) == 1) records.push_back(record);
  std::fclose(file);
  return records;
}

// The optimiser must take this value as read.
template <class T> void keep(const T &value) { asm volatile("" : : "g"(&value) : "memory"); }

// `work` is what is timed, for one input in the peer's own form; `show` writes its answers as numbers: how many, then each.
template <class Input, class Work, class Show>
int serve(const std::vector<Input> &inputs, const char *passes, Work work, Show show) {
  const auto run = [&](unsigned long count) {
    for (unsigned long pass = 0; pass < count; ++pass) {
      for (const Input &input : inputs) keep(work(input));
    }
  };
  if (passes) {
    run(std::strtoul(passes, nullptr, 10));
    return 0;
  }
  char line[64];
  while (std::fgets(line, sizeof line, stdin)) {
    if (std::strncmp(line, "run ", 4) == 0) {
      const unsigned long count = std::strtoul(line + 4, nullptr, 10);
      const auto start = std::chrono::steady_clock::now();
      run(count);
      const std::chrono::nanoseconds spent = std::chrono::steady_clock::now() - start;
      std::printf("%lld\n", static_cast<long long>(spent.count()));
    } else if (std::strcmp(line, "show\n") == 0) {
      std::vector<double> numbers;
      for (const Input &input : inputs) {
        numbers.clear();
        show(work(input), numbers);
        std::fwrite(numbers.data(), sizeof(double), numbers.size(), stdout);
      }
    } else {
      std::fprintf(stderr, "not understood: %s", line);
      return 1;
    }
    std::fflush(stdout);
  }
  return 0;
}
