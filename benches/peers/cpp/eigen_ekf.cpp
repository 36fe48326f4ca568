// The filter with dense matrices by Eigen (https://eigen.tuxfamily.org), UR10e: `worker 12|13 ur10e TAPE [PASSES]`.
//   12   the kernel's own filter: position, rotation vector and rates as one update of twelve rows
//   13   the paper's (KRAKEN, section 3.2, Table 3): position, quaternion, subtracted as it is, and rates
#include "worker.hpp"
#include <Eigen/Dense>
#include <cmath>
#include <string>

constexpr int N = 6, X = 3 * N;
using State = Eigen::Matrix<double, X, 1>;
using Covariance = Eigen::Matrix<double, X, X>;
using Eigen::Matrix3d;
using Eigen::Vector3d;

struct Pose {
  Matrix3d rotation = Matrix3d::Identity();
  Vector3d translation = Vector3d::Zero();
  Pose operator*(const Pose &inner) const {
    return {rotation * inner.rotation, rotation * inner.translation + translation};
  }
  Pose inverse() const { return {rotation.transpose(), -(rotation.transpose() * translation)}; }
};

struct Tick {
  Pose tracker_from_target, tracker_from_base, flange_from_target;
  Eigen::Matrix<double, N, 1> rates;
};

// As benches/peers/src/filter/tape.rs writes it.
struct Tape {
  double dt, density, position, rotation, rate, start[3];
  Eigen::Matrix<double, N, 1> joints;
  std::vector<Tick> ticks;
};

Tape read_tape(const char *path) {
  std::FILE *file = std::fopen(path, "rb");
  if (!file) {
    std::perror(path);
    std::exit(1);
  }
  const auto fill = [&](double *numbers, std::size_t count) {
    return std::fread(numbers, sizeof(double), count, file) == count;
  };
  Tape tape;
  double head[8 + N], numbers[3 * 12 + N];
  if (!fill(head, 8 + N)) std::exit(1);
  tape.dt = head[0], tape.density = head[1], tape.position = head[2], tape.rotation = head[3], tape.rate = head[4];
  for (int k = 0; k < 3; ++k) tape.start[k] = head[5 + k];
  for (int i = 0; i < N; ++i) tape.joints(i) = head[8 + i];
  while (fill(numbers, 3 * 12 + N)) {
    Tick tick;
    Pose *poses[] = {&tick.tracker_from_target, &tick.tracker_from_base, &tick.flange_from_target};
    for (int k = 0; k < 3; ++k) {
      for (int row = 0; row < 3; ++row) {
        for (int column = 0; column < 3; ++column) poses[k]->rotation(row, column) = numbers[12 * k + 4 * row + column];
        poses[k]->translation(row) = numbers[12 * k + 4 * row + 3];
      }
    }
    for (int i = 0; i < N; ++i) tick.rates(i) = numbers[36 + i];
    tape.ticks.push_back(tick);
  }
  std::fclose(file);
  return tape;
}

// Standard DH table of the UR10e, as in kernel/src/arms/ur.rs: a, d, sin and cos of alpha.
const double table[N][4] = {{0, 0.1807, 1, 0},        {-0.6127, 0, 0, 1},    {-0.57155, 0, 0, 1},
                            {0, 0.17415, 1, 0}, {0, 0.11985, -1, 0}, {0, 0.11655, 0, 1}};

struct Kinematics {
  Pose flange;
  Vector3d axes[N], origins[N];
};

Kinematics forward(const State &x) {
  Kinematics k;
  Matrix3d r = Matrix3d::Identity();
  Vector3d p = Vector3d::Zero();
  for (int i = 0; i < N; ++i) {
    k.axes[i] = r.col(2);
    k.origins[i] = p;
    const double s = std::sin(x(i)), c = std::cos(x(i)), a = table[i][0], d = table[i][1], sa = table[i][2], ca = table[i][3];
    const Vector3d along = r.col(0) * c + r.col(1) * s, turned = r.col(1) * c - r.col(0) * s, up = r.col(2);
    p += up * d + along * a;
    r.col(0) = along;
    r.col(1) = turned * ca + up * sa;
    r.col(2) = up * ca - turned * sa;
  }
  k.flange = {r, p};
  return k;
}

// Axis times angle, for the small turns that are met here.
Vector3d rotation_vector(const Matrix3d &r) {
  const Vector3d twice(r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1));
  const double sine = 0.5 * twice.norm(), angle = std::atan2(sine, 0.5 * (r.trace() - 1));
  return sine < 1e-12 ? Vector3d(0.5 * twice) : Vector3d(twice * (0.5 * angle / sine));
}

struct Filter {
  State x;
  Covariance p, f, q;
  const Tape *tape;

  explicit Filter(const Tape &tape) : tape(&tape) {
    x.setZero();
    x.head<N>() = tape.joints;
    p.setZero(), f.setIdentity(), q.setZero();
    const double t = tape.dt, t2 = t * t, t3 = t2 * t, t4 = t3 * t, t5 = t4 * t;
    const double white[3][3] = {{t5 / 20, t4 / 8, t3 / 6}, {t4 / 8, t3 / 3, t2 / 2}, {t3 / 6, t2 / 2, t}};
    for (int i = 0; i < N; ++i) {
      f(i, i + N) = f(i + N, i + 2 * N) = t;
      f(i, i + 2 * N) = 0.5 * t2;
      for (int a = 0; a < 3; ++a) {
        p(i + a * N, i + a * N) = tape.start[a] * tape.start[a];
        for (int b = 0; b < 3; ++b) q(i + a * N, i + b * N) = tape.density * white[a][b];
      }
    }
  }

  // Z rows: 12 or 13.
  template <int Z> void tick(const Tick &tick) {
    constexpr int R = Z - N;
    x = f * x;
    p = f * p * f.transpose() + q;
    const Kinematics k = forward(x);
    const Pose expected = k.flange * tick.flange_from_target, measured = tick.tracker_from_base.inverse() * tick.tracker_from_target;
    Eigen::Matrix<double, Z, X> h = Eigen::Matrix<double, Z, X>::Zero();
    Eigen::Matrix<double, Z, 1> y, r;
    y.template head<3>() = measured.translation - expected.translation;
    r.template head<3>().setConstant(tape->position * tape->position);
    const Eigen::Quaterniond is(expected.rotation);
    if constexpr (Z == 12) {
      y.template segment<3>(3) = rotation_vector(measured.rotation * expected.rotation.transpose());
      r.template segment<3>(3).setConstant(tape->rotation * tape->rotation);
    } else {
      const Eigen::Quaterniond z(measured.rotation);
      const double sign = is.dot(z) < 0 ? -1 : 1;
      y.template segment<4>(3) << sign * z.w() - is.w(), sign * z.vec() - is.vec();
      r.template segment<4>(3).setConstant(0.25 * tape->rotation * tape->rotation);
    }
    for (int i = 0; i < N; ++i) {
      const Vector3d &axis = k.axes[i];
      h.template block<3, 1>(0, i) = axis.cross(expected.translation - k.origins[i]);
      if constexpr (Z == 12) {
        h.template block<3, 1>(3, i) = axis;
      } else {
        h(3, i) = -0.5 * axis.dot(is.vec());
        h.template block<3, 1>(4, i) = 0.5 * (axis * is.w() + axis.cross(is.vec()));
      }
      h(R + i, N + i) = 1;
    }
    y.template tail<N>() = tick.rates - x.template segment<N>(N);
    r.template tail<N>().setConstant(tape->rate * tape->rate);
    const Eigen::Matrix<double, Z, X> hp = h * p;
    Eigen::Matrix<double, Z, Z> s = hp * h.transpose();
    if constexpr (Z == 12) {
      // What the pose bends away from its tangent, as in the kernel.
      const double way = s.template topLeftCorner<3, 3>().trace(), turn = s.template block<3, 3>(3, 3).trace();
      r.template head<3>().array() += 0.25 * way * turn;
      r.template segment<3>(3).array() += 0.25 * turn * turn;
    }
    s.diagonal() += r;
    const Eigen::LLT<Eigen::Matrix<double, Z, Z>> factor(s);
    if (factor.info() != Eigen::Success) std::exit(1);
    const Eigen::Matrix<double, Z, X> solved = factor.solve(hp);
    x += solved.transpose() * y;
    p -= solved.transpose() * hp;
  }
};

template <int Z> int work(const std::vector<Tape> &tapes, const char *passes) {
  const auto play = [](const Tape &tape) {
    Filter filter(tape);
    for (const Tick &tick : tape.ticks) filter.tick<Z>(tick);
    return filter;
  };
  const auto show = [](const Filter &filter, std::vector<double> &numbers) {
    numbers.push_back(1);
    numbers.insert(numbers.end(), filter.x.data(), filter.x.data() + X);
    numbers.insert(numbers.end(), filter.p.data(), filter.p.data() + X * X);
  };
  return serve(tapes, passes, play, show);
}

int main(int argc, char **argv) {
  if (argc < 4 || std::string(argv[2]) != "ur10e") return 2;
  const std::vector<Tape> tapes{read_tape(argv[3])};
  const char *passes = argc > 4 ? argv[4] : nullptr;
  const std::string rows = argv[1];
  if (rows == "12") return work<12>(tapes, passes);
  if (rows == "13") return work<13>(tapes, passes);
  return 2;
}
