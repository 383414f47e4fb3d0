// The closure equation with ten derivatives by Ceres Solver's automatic differentiation, and fits with it.
//
// Usage: closure samples DATA, or closure fit DATA. The formats of the data are those of `samples::text` and
// `fits::text`; the protocol is that of `Program` in `program.rs`: a line in, a line per contender and an empty
// line out.

#include <ceres/ceres.h>
#include <ceres/jet.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace {

using Sample = std::array<double, 7>;  // q, x, y, z, alpha, beta, gamma
using Parameters = std::array<double, 10>;
using Row = std::array<double, 11>;  // residual and derivatives

constexpr int kCalls = 5;

// weight * (L^2 - |T + Rz(alpha) Ry(beta) Rz(gamma) P - O - q v|^2)
struct Closure {
  Sample sample;
  double weight;

  template <typename T>
  bool operator()(const T* p, T* residual) const {
    const auto& [q, x, y, z, alpha, beta, gamma] = sample;
    const double sa = std::sin(alpha), ca = std::cos(alpha);
    const double sb = std::sin(beta), cb = std::cos(beta);
    const double sc = std::sin(gamma), cc = std::cos(gamma);
    const T u = cc * p[1] - sc * p[2], v = sc * p[1] + cc * p[2];
    const T w = cb * u + sb * p[3], k = cb * p[3] - sb * u;
    const T dx = x + ca * w - sa * v - p[4] - q * p[7];
    const T dy = y + sa * w + ca * v - p[5] - q * p[8];
    const T dz = z + k - p[6] - q * p[9];
    residual[0] = weight * (p[0] * p[0] - dx * dx - dy * dy - dz * dz);
    return true;
  }
};

struct Prior {
  Parameters mean;
  Parameters sigma;

  template <typename T>
  bool operator()(const T* p, T* residual) const {
    for (int i = 0; i < 10; ++i) residual[i] = (p[i] - mean[i]) / sigma[i];
    return true;
  }
};

using CostFunction = ceres::AutoDiffCostFunction<Closure, 1, 10>;

double Least(int calls, const std::function<void()>& run) {
  double least = HUGE_VAL;
  for (int call = 0; call < calls; ++call) {
    const auto started = std::chrono::steady_clock::now();
    run();
    const std::chrono::duration<double> elapsed =
        std::chrono::steady_clock::now() - started;
    least = std::min(least, elapsed.count());
  }
  return least;
}

// The largest difference, each column's relative to the largest number in it.
double Difference(const std::vector<Row>& rows, const std::vector<Row>& reference) {
  double worst = 0.0;
  for (int column = 0; column < 11; ++column) {
    double largest = 0.0, scale = 0.0;
    for (size_t i = 0; i < rows.size(); ++i) {
      largest = std::max(largest, std::abs(rows[i][column] - reference[i][column]));
      scale = std::max(scale, std::abs(reference[i][column]));
    }
    worst = std::max(worst, largest / scale);
  }
  return worst;
}

int Samples(std::ifstream& in) {
  size_t count = 0;
  Parameters parameters;
  in >> count;
  for (double& p : parameters) in >> p;
  std::vector<Sample> samples(count);
  std::vector<Row> reference(count), rows(count);
  for (size_t i = 0; i < count; ++i) {
    for (double& number : samples[i]) in >> number;
    for (double& number : reference[i]) in >> number;
  }
  if (!in) return 2;

  const auto jets = [&] {
    using Jet = ceres::Jet<double, 10>;
    std::array<Jet, 10> p;
    for (int i = 0; i < 10; ++i) p[i] = Jet(parameters[i], i);
    for (size_t i = 0; i < count; ++i) {
      Jet residual;
      Closure{samples[i], 1.0}(p.data(), &residual);
      rows[i][0] = residual.a;
      std::copy_n(residual.v.data(), 10, &rows[i][1]);
    }
  };
  std::vector<std::unique_ptr<ceres::CostFunction>> functions;
  for (const Sample& sample : samples) {
    functions.push_back(std::make_unique<CostFunction>(new Closure{sample, 1.0}));
  }
  const auto virtually = [&] {
    const double* blocks[] = {parameters.data()};
    for (size_t i = 0; i < count; ++i) {
      double* jacobian[] = {&rows[i][1]};
      functions[i]->Evaluate(blocks, &rows[i][0], jacobian);
    }
  };
  for (std::string line; std::getline(std::cin, line);) {
    for (const auto& [name, run] :
         {std::pair<const char*, std::function<void()>>{"jet", jets},
          {"cost function", virtually}}) {
      const double seconds = Least(kCalls, run);
      std::printf("%s\t%.9e\t%.3e\n", name, seconds, Difference(rows, reference));
    }
    std::printf("\n");
    std::fflush(stdout);
  }
  return 0;
}

// One solve of a link's parameters; the time is that of ceres::Solve alone.
int Fit(std::ifstream& in) {
  size_t count = 0;
  double weight = 0.0, tolerance = 0.0;
  Parameters start, values;
  Prior prior;
  in >> count >> weight >> tolerance;
  for (double& p : start) in >> p;
  for (double& p : prior.mean) in >> p;
  for (double& p : prior.sigma) in >> p;
  std::vector<Sample> samples(count);
  for (Sample& sample : samples) {
    for (double& number : sample) in >> number;
  }
  if (!in) return 2;

  ceres::Problem problem;
  problem.AddResidualBlock(
      new ceres::AutoDiffCostFunction<Prior, 10, 10>(new Prior(prior)), nullptr,
      values.data());
  for (const Sample& sample : samples) {
    problem.AddResidualBlock(new CostFunction(new Closure{sample, weight}), nullptr,
                             values.data());
  }
  ceres::Solver::Options options;
  // The problem is nearly linear: a radius that does not bind saves it steps.
  options.initial_trust_region_radius = 1e16;
  options.function_tolerance = tolerance;
  options.gradient_tolerance = 0.0;
  options.parameter_tolerance = 0.0;
  options.logging_type = ceres::SILENT;
  const int all_threads = std::max(2u, std::thread::hardware_concurrency());
  for (std::string line; std::getline(std::cin, line);) {
    for (const auto method : {ceres::DENSE_QR, ceres::DENSE_NORMAL_CHOLESKY}) {
      for (const int threads : {1, all_threads}) {
        options.linear_solver_type = method;
        options.num_threads = threads;
        values = start;
        ceres::Solver::Summary summary;
        const double seconds =
            Least(1, [&] { ceres::Solve(options, &problem, &summary); });
        std::printf("%s, threads: %d\t%.9e\t%.17e\n",
                    ceres::LinearSolverTypeToString(method), threads, seconds,
                    summary.final_cost);
      }
    }
    std::printf("\n");
    std::fflush(stdout);
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string mode = argc == 3 ? argv[1] : "";
  std::ifstream in(argc == 3 ? argv[2] : "");
  if (mode == "samples") return Samples(in);
  if (mode == "fit") return Fit(in);
  std::cerr << "usage: closure samples DATA | closure fit DATA\n";
  return 2;
}
