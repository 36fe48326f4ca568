// What every worker in C++ has in common: the protocol of benches/peers/src/worker.rs.
#pragma once
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
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

// Time that this process has had on a processor (ns): what the machine does meanwhile for others is left out.
inline long long processor_time() {
  timespec time;
  if (clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time) != 0) {
    std::perror("clock_gettime");
    std::exit(1);
  }
  return time.tv_sec * 1'000'000'000LL + time.tv_nsec;
}

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
      const long long start = processor_time();
      run(count);
      std::printf("%lld\n", processor_time() - start);
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
