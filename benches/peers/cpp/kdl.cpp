// Orocos KDL (https://www.orocos.org/kdl), UR10e: `worker jacobian ur10e INPUTS [PASSES]`: pose and Jacobian of the flange.
#include "worker.hpp"
#include <kdl/chain.hpp>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainjnttojacsolver.hpp>
#include <string>

struct Answer {
  KDL::Frame pose;
  KDL::Jacobian jacobian{6};
};

int main(int argc, char **argv) {
  if (argc < 4 || std::string(argv[1]) != "jacobian" || std::string(argv[2]) != "ur10e") return 2;
  // Standard DH table of the UR10e, as in kernel/src/arms/ur.rs.
  const double table[6][3] = {{0, M_PI_2, 0.1807}, {-0.6127, 0, 0}, {-0.57155, 0, 0}, {0, M_PI_2, 0.17415},
                              {0, -M_PI_2, 0.11985}, {0, 0, 0.11655}};
  KDL::Chain chain;
  for (const auto &row : table) {
    chain.addSegment(KDL::Segment(KDL::Joint(KDL::Joint::RotZ), KDL::Frame::DH(row[0], row[1], row[2], 0)));
  }
  KDL::ChainFkSolverPos_recursive position(chain);
  KDL::ChainJntToJacSolver jacobian(chain);
  std::vector<KDL::JntArray> inputs;
  for (const Record &record : read_records(argv[3])) {
    KDL::JntArray joints(6);
    for (int i = 0; i < 6; ++i) joints(i) = record.joints[i];
    inputs.push_back(joints);
  }
  // As its user would write it in a loop: memory for the answer is there already.
  Answer answer;
  const auto work = [&](const KDL::JntArray &joints) -> const Answer & {
    if (position.JntToCart(joints, answer.pose) < 0 || jacobian.JntToJac(joints, answer.jacobian) < 0) std::exit(1);
    return answer;
  };
  const auto show = [](const Answer &answer, std::vector<double> &numbers) {
    numbers.push_back(1);
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) numbers.push_back(answer.pose.M(row, column));
      numbers.push_back(answer.pose.p(row));
    }
    for (int column = 0; column < 6; ++column) {
      for (int row = 0; row < 6; ++row) numbers.push_back(answer.jacobian(row, column));
    }
  };
  return serve(inputs, argc > 4 ? argv[4] : nullptr, work, show);
}
