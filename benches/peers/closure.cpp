// The closure equation with ten derivatives by Ceres Solver's automatic differentiation, and fits with it.
//
// Usage: closure samples DATA, closure fit DATA or closure variant DATA. The formats of the data are those of
// `samples::text`, `one_link::text` and `variants::text`; the protocol is that of `Program` in `program.rs`: a line in, a line per contender and an empty
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

// The closure of a link or a cluster: with a plate joint or without, on a straight track or on a segment of a
// measured one that three small angles turn.
struct VariantClosure {
  bool plate_joint;
  bool piecewise;
  std::vector<double> data;
  double weight;

  template <typename T>
  bool operator()(const T* p, T* residual) const {
    const double* d = data.data();
    T rod[3] = {T(d[1]), T(d[2]), T(d[3])};
    const T* offset = p + 1;
    if (plate_joint) {
      const double sa = std::sin(d[4]), ca = std::cos(d[4]);
      const double sb = std::sin(d[5]), cb = std::cos(d[5]);
      const double sc = std::sin(d[6]), cc = std::cos(d[6]);
      const T u = cc * p[1] - sc * p[2], v = sc * p[1] + cc * p[2];
      const T w = cb * u + sb * p[3], k = cb * p[3] - sb * u;
      rod[0] += ca * w - sa * v;
      rod[1] += sa * w + ca * v;
      rod[2] += k;
      offset = p + 4;
    }
    const T* path = offset + 3;
    T point[3];
    if (piecewise) {
      const double* segment = d + (plate_joint ? 7 : 4);
      const double share = (d[0] - segment[6]) / (segment[7] - segment[6]);
      double at[3];
      for (int i = 0; i < 3; ++i) {
        at[i] = segment[i] + share * (segment[3 + i] - segment[i]);
      }
      using std::cos;
      using std::sin;
      const T sx = sin(path[0]), cx = cos(path[0]), sy = sin(path[1]);
      const T cy = cos(path[1]), sz = sin(path[2]), cz = cos(path[2]);
      const T y = cx * at[1] - sx * at[2], z = sx * at[1] + cx * at[2];
      const T x = cy * at[0] + sy * z;
      point[0] = cz * x - sz * y;
      point[1] = sz * x + cz * y;
      point[2] = cy * z - sy * at[0];
    } else {
      for (int i = 0; i < 3; ++i) point[i] = d[0] * path[i];
    }
    T square(0.0);
    for (int i = 0; i < 3; ++i) {
      rod[i] -= offset[i] + point[i];
      square += rod[i] * rod[i];
    }
    residual[0] = weight * (p[0] * p[0] - square);
    return true;
  }
};

// N parameters of a closure: differences from their means, times weights.
template <int N>
struct VariantPrior {
  std::vector<double> mean, weights;

  template <typename T>
  bool operator()(const T* p, T* residual) const {
    for (int i = 0; i < N; ++i) residual[i] = (p[i] - mean[i]) * weights[i];
    return true;
  }
};

template <int N>
void AddVariant(ceres::Problem& problem, double* values, const std::vector<double>& mean,
                const std::vector<double>& weights,
                const std::vector<VariantClosure>& closures) {
  problem.AddResidualBlock(new ceres::AutoDiffCostFunction<VariantPrior<N>, N, N>(
                               new VariantPrior<N>{mean, weights}),
                           nullptr, values);
  for (const VariantClosure& closure : closures) {
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<VariantClosure, 1, N>(
                                 new VariantClosure(closure)),
                             nullptr, values);
  }
}

// The closures of a variant, one after the other; the time is that of ceres::Solve alone.
int Variant(std::ifstream& in) {
  size_t closures = 0, poses = 0;
  double weight = 0.0, tolerance = 0.0;
  in >> closures >> poses >> weight >> tolerance;
  std::vector<std::vector<double>> starts, values;
  std::vector<std::unique_ptr<ceres::Problem>> problems;
  for (size_t c = 0; c < closures; ++c) {
    bool plate_joint = false, piecewise = false;
    size_t parameters = 0, width = 0;
    in >> plate_joint >> piecewise >> parameters >> width;
    std::vector<double> start(parameters), weights(parameters);
    for (double& number : start) in >> number;
    for (double& number : weights) {
      in >> number;
      number = number > 0.0 ? 1.0 / number : 0.0;
    }
    std::vector<VariantClosure> residuals(poses);
    for (VariantClosure& closure : residuals) {
      closure = {plate_joint, piecewise, std::vector<double>(width), weight};
      for (double& number : closure.data) in >> number;
    }
    starts.push_back(start);
    values.push_back(start);
    problems.push_back(std::make_unique<ceres::Problem>());
    const auto add = parameters == 10 ? AddVariant<10> : AddVariant<7>;
    add(*problems.back(), values.back().data(), start, weights, residuals);
  }
  if (!in) return 2;
  ceres::Solver::Options options;
  options.function_tolerance = tolerance;
  options.gradient_tolerance = 0.0;
  options.parameter_tolerance = 0.0;
  options.max_num_iterations = 1000;
  options.logging_type = ceres::SILENT;
  for (std::string line; std::getline(std::cin, line);) {
    for (const auto method : {ceres::DENSE_QR, ceres::DENSE_NORMAL_CHOLESKY}) {
      options.linear_solver_type = method;
      double seconds = HUGE_VAL, cost = 0.0;
      // The radius that suits it best: one that does not bind, or the default.
      for (const double radius : {1e16, 1e4}) {
        options.initial_trust_region_radius = radius;
        double total = 0.0, sum = 0.0;
        for (size_t c = 0; c < closures; ++c) {
          std::copy(starts[c].begin(), starts[c].end(), values[c].begin());
          ceres::Solver::Summary summary;
          total += Least(1, [&] { ceres::Solve(options, problems[c].get(), &summary); });
          sum += summary.final_cost;
        }
        if (total < seconds) {
          seconds = total;
          cost = sum;
        }
      }
      std::printf("%s\t%.9e\t%.17e\n", ceres::LinearSolverTypeToString(method),
                  seconds, cost);
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
  if (mode == "variant") return Variant(in);
  std::cerr << "usage: closure samples DATA | closure fit DATA | closure variant DATA\n";
  return 2;
}
