// ur-analytic-ik (https://github.com/Victorlouisdg/ur-analytic-ik), UR10e: `worker ITEM ur10e INPUTS [PASSES]`.
#include <tuple>
#include "ur_analytic_ik/inverse_kinematics.hh"
#include "worker.hpp"
#include <string>

struct Input {
  Matrix4x4 pose;
  double seed[6];
};

int main(int argc, char **argv) {
  if (argc < 4 || std::string(argv[2]) != "ur10e") return 2;
  // Its warnings would get into the answers.
  std::cout.rdbuf(std::cerr.rdbuf());
  std::vector<Input> inputs;
  for (const Record &record : read_records(argv[3])) {
    Input input;
    input.pose.setIdentity();
    for (int i = 0; i < 12; ++i) input.pose(i / 4, i % 4) = record.pose[i];
    std::memcpy(input.seed, record.seed, sizeof input.seed);
    inputs.push_back(input);
  }
  const auto all = [](const Input &input) { return ur10e::inverse_kinematics(input.pose); };
  const auto nearest = [](const Input &input) {
    const double *q = input.seed;
    return ur10e::inverse_kinematics_closest(input.pose, q[0], q[1], q[2], q[3], q[4], q[5]);
  };
  const auto show = [](const std::vector<Matrix1x6> &answers, std::vector<double> &numbers) {
    numbers.push_back(static_cast<double>(answers.size()));
    for (const Matrix1x6 &joints : answers) numbers.insert(numbers.end(), joints.data(), joints.data() + 6);
  };
  const std::string item = argv[1];
  const char *passes = argc > 4 ? argv[4] : nullptr;
  if (item == "all") return serve(inputs, passes, all, show);
  if (item == "nearest") return serve(inputs, passes, nearest, show);
  return 2;
}
