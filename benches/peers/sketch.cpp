// A router on four belts and readings of its drives at unknown places, with Ceres Solver: benches/sketch.rs.
//
// Usage: sketch DATA METHOD RADIUS THREADS TOLERANCE TURNS, with METHOD DENSE_SCHUR, SPARSE_SCHUR or ITERATIVE_SCHUR and
// the first trust radius.
//
// DATA holds, as text: number of shared parameters and of readings; for each shared parameter its name, start, mean and
// standard deviation of its prior (m); for each reading the place to start from (m), the commands (m) and the weight of
// each closure (1/m^2).
//
// Prints "result SECONDS ITERATIONS COST". The time is that of ceres::Solve, without reading, the least of so many turns.

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

namespace {

constexpr int kShared = 11;
// Order in which the parameter block holds them: anchors of the belts, then what all belts share.
const std::array<std::string, kShared> kNames = {
    "top_left_x",    "top_left_y",    "top_right_x",    "top_right_y",
    "bottom_left_x", "bottom_left_y", "bottom_right_x", "bottom_right_y",
    "arm",           "height",        "zero"};

struct Reading {
  std::array<double, 2> place;
  std::array<double, 4> command;
  std::array<double, 4> weight;
};

// L^2 - |T - A|^2 of the four belts, weighted, with L = arm + sqrt((zero + q)^2 - height^2).
struct Belts : ceres::SizedCostFunction<4, kShared, 2> {
  explicit Belts(const Reading* reading) : reading(reading) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const double* p = parameters[0];
    const double* u = parameters[1];
    double* shared = jacobians ? jacobians[0] : nullptr;
    double* own = jacobians ? jacobians[1] : nullptr;
    if (shared) std::fill(shared, shared + 4 * kShared, 0.0);
    for (int k = 0; k < 4; ++k) {
      const double w = reading->weight[k];
      const double dx = reading->place[0] + u[0] - p[2 * k];
      const double dy = reading->place[1] + u[1] - p[2 * k + 1];
      const double whole = p[10] + reading->command[k];
      const double root = std::sqrt(whole * whole - p[9] * p[9]);
      const double length = p[8] + root;
      residuals[k] = w * (length * length - dx * dx - dy * dy);
      if (shared) {
        double* row = shared + k * kShared;
        row[2 * k] = 2 * w * dx;
        row[2 * k + 1] = 2 * w * dy;
        row[8] = 2 * w * length;
        row[9] = -2 * w * length * p[9] / root;
        row[10] = 2 * w * length * whole / root;
      }
      if (own) {
        own[2 * k] = -2 * w * dx;
        own[2 * k + 1] = -2 * w * dy;
      }
    }
    return true;
  }

  const Reading* reading;
};

struct Prior : ceres::SizedCostFunction<kShared, kShared> {
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    for (int i = 0; i < kShared; ++i) {
      residuals[i] = (parameters[0][i] - mean[i]) / sigma[i];
    }
    if (jacobians && jacobians[0]) {
      std::fill(jacobians[0], jacobians[0] + kShared * kShared, 0.0);
      for (int i = 0; i < kShared; ++i) {
        jacobians[0][i * kShared + i] = 1.0 / sigma[i];
      }
    }
    return true;
  }

  std::array<double, kShared> mean{};
  std::array<double, kShared> sigma{};
};

}  // namespace

int main(int argc, char** argv) {
  if (argc != 7) {
    std::cerr << "usage: sketch DATA METHOD RADIUS THREADS TOLERANCE TURNS\n";
    return 2;
  }
  std::ifstream in(argv[1]);
  int shared = 0, count = 0;
  in >> shared >> count;
  std::array<double, kShared> values{};
  auto* prior = new Prior;
  int known = 0;
  for (int k = 0; k < shared; ++k) {
    std::string name;
    double start, mean, sigma;
    in >> name >> start >> mean >> sigma;
    for (int i = 0; i < kShared; ++i) {
      if (name == kNames[i]) {
        values[i] = start;
        prior->mean[i] = mean;
        prior->sigma[i] = sigma;
        ++known;
      }
    }
  }
  std::vector<Reading> readings(count);
  for (Reading& reading : readings) {
    for (double& x : reading.place) in >> x;
    for (double& q : reading.command) in >> q;
    for (double& w : reading.weight) in >> w;
  }
  if (!in || shared != kShared || known != kShared) {
    std::cerr << "the data can't be read\n";
    return 2;
  }

  std::vector<std::array<double, 2>> unknowns(count, {0.0, 0.0});
  ceres::Problem problem;
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  problem.AddResidualBlock(prior, nullptr, values.data());
  ordering->AddElementToGroup(values.data(), 1);
  for (int k = 0; k < count; ++k) {
    problem.AddResidualBlock(new Belts(&readings[k]), nullptr, values.data(),
                             unknowns[k].data());
    ordering->AddElementToGroup(unknowns[k].data(), 0);
  }

  ceres::Solver::Options options;
  const std::string method = argv[2];
  options.linear_solver_type = method == "DENSE_SCHUR" ? ceres::DENSE_SCHUR
                               : method == "ITERATIVE_SCHUR"
                                   ? ceres::ITERATIVE_SCHUR
                                   : ceres::SPARSE_SCHUR;
  options.linear_solver_ordering = ordering;
  options.initial_trust_region_radius = std::stod(argv[3]);
  options.num_threads = std::stoi(argv[4]);
  options.function_tolerance = std::stod(argv[5]);
  options.gradient_tolerance = 0.0;
  options.parameter_tolerance = 0.0;
  options.max_num_iterations = 1000;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  const std::array<double, kShared> start = values;
  double seconds = INFINITY;
  for (int turn = 0; turn < std::stoi(argv[6]); ++turn) {
    values = start;
    std::fill(unknowns.begin(), unknowns.end(), std::array<double, 2>{0.0, 0.0});
    const auto started = std::chrono::steady_clock::now();
    ceres::Solve(options, &problem, &summary);
    const std::chrono::duration<double> taken =
        std::chrono::steady_clock::now() - started;
    seconds = std::min(seconds, taken.count());
  }
  std::printf("result %.9f %zu %.17e\n", seconds, summary.iterations.size() - 1,
              summary.final_cost);
  return 0;
}
