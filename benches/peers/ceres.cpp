// Errors in variables with Ceres Solver: the problem of benches/errors_in_variables.rs.
//
// Usage: ceres DATA METHOD THREADS TOLERANCE, with METHOD DENSE_SCHUR or SPARSE_SCHUR.
//
// DATA holds, as text: number of links, of shared parameters and of poses, noise of position (m) and of
// rotation (rad); for each link the index of its track; for each shared parameter its name, start, mean and
// standard deviation of its prior; for each pose the commands (m), measured position (m), ZYZ Euler angles
// (rad) and for each link the weight of its closure (1/m^2). A link has ten shared parameters.
//
// Prints "result SECONDS ITERATIONS COST PEAK_MIB". The time is that of ceres::Solve, without reading.

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace {

// Quantities of a link in the order in which its parameter block holds them.
const std::array<std::string, 10> kQuantities = {
    "length",           "plate_joint.x",    "plate_joint.y",
    "plate_joint.z",    "track_offset.x",   "track_offset.y",
    "track_offset.z",   "track_direction.x", "track_direction.y",
    "track_direction.z"};

struct Pose {
  std::vector<double> commands;
  std::array<double, 3> position;
  std::array<double, 9> rotation;  // row-major
  std::vector<double> weights;
};

// L^2 - |T + R P - C(q)|^2 of a link at the true pose, over its standard deviation.
struct Closure {
  const Pose* pose;
  double command;
  double weight;

  template <typename T>
  bool operator()(const T* link, const T* unknowns, T* residual) const {
    const auto& r = pose->rotation;
    T turned[3];
    for (int i = 0; i < 3; ++i) {
      turned[i] = r[3 * i] * link[1] + r[3 * i + 1] * link[2] +
                  r[3 * i + 2] * link[3];
    }
    T joint[3];
    ceres::AngleAxisRotatePoint(unknowns + 3, turned, joint);
    T square(0.0);
    for (int i = 0; i < 3; ++i) {
      const T difference = pose->position[i] + unknowns[i] + joint[i] -
                           link[4 + i] - command * link[7 + i];
      square += difference * difference;
    }
    residual[0] = weight * (link[0] * link[0] - square);
    return true;
  }
};

// All measured coordinates of a pose against the true ones.
struct Measured {
  double position;
  double rotation;

  template <typename T>
  bool operator()(const T* unknowns, T* residual) const {
    for (int i = 0; i < 3; ++i) {
      residual[i] = unknowns[i] / position;
      residual[3 + i] = unknowns[3 + i] / rotation;
    }
    return true;
  }
};

struct LinkPrior {
  std::array<double, 10> mean;
  std::array<double, 10> sigma;

  template <typename T>
  bool operator()(const T* link, T* residual) const {
    for (int i = 0; i < 10; ++i) residual[i] = (link[i] - mean[i]) / sigma[i];
    return true;
  }
};

std::array<double, 9> Zyz(double a, double b, double c) {
  const double sa = std::sin(a), ca = std::cos(a);
  const double sb = std::sin(b), cb = std::cos(b);
  const double sc = std::sin(c), cc = std::cos(c);
  return {ca * cb * cc - sa * sc, -ca * cb * sc - sa * cc, ca * sb,
          sa * cb * cc + ca * sc, -sa * cb * sc + ca * cc, sa * sb,
          -sb * cc,               sb * sc,                 cb};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 5) {
    std::cerr << "usage: ceres DATA METHOD THREADS TOLERANCE\n";
    return 2;
  }
  std::ifstream in(argv[1]);
  int links = 0, shared = 0, poses = 0;
  double position_noise = 0, rotation_noise = 0;
  in >> links >> shared >> poses >> position_noise >> rotation_noise;
  std::vector<int> tracks(links);
  for (int& track : tracks) in >> track;
  std::map<std::string, int> link_of;
  std::vector<std::array<double, 10>> values(links);
  std::vector<LinkPrior> priors(links);
  for (int k = 0; k < shared; ++k) {
    std::string name;
    double start, mean, sigma;
    in >> name >> start >> mean >> sigma;
    const auto dot = name.find('.');
    const int next = static_cast<int>(link_of.size());
    const int link = link_of.emplace(name.substr(0, dot), next).first->second;
    for (int i = 0; i < 10; ++i) {
      if (name.substr(dot + 1) == kQuantities[i]) {
        values[link][i] = start;
        priors[link].mean[i] = mean;
        priors[link].sigma[i] = sigma;
      }
    }
  }
  const int commands =
      1 + *std::max_element(tracks.begin(), tracks.end());
  std::vector<Pose> measured(poses);
  for (Pose& pose : measured) {
    pose.commands.resize(commands);
    for (double& command : pose.commands) in >> command;
    for (double& x : pose.position) in >> x;
    double a, b, c;
    in >> a >> b >> c;
    pose.rotation = Zyz(a, b, c);
    pose.weights.resize(links);
    for (double& weight : pose.weights) in >> weight;
  }
  if (!in || shared != 10 * links) {
    std::cerr << "the data can't be read\n";
    return 2;
  }

  std::vector<std::array<double, 6>> unknowns(poses);
  ceres::Problem problem;
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (int l = 0; l < links; ++l) {
    problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<LinkPrior, 10, 10>(
            new LinkPrior(priors[l])),
        nullptr, values[l].data());
    ordering->AddElementToGroup(values[l].data(), 1);
  }
  for (int p = 0; p < poses; ++p) {
    const Pose& pose = measured[p];
    double* own = unknowns[p].data();
    unknowns[p].fill(0.0);
    for (int l = 0; l < links; ++l) {
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<Closure, 1, 10, 6>(new Closure{
              &pose, pose.commands[tracks[l]], pose.weights[l]}),
          nullptr, values[l].data(), own);
    }
    problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<Measured, 6, 6>(
            new Measured{position_noise, rotation_noise}),
        nullptr, own);
    ordering->AddElementToGroup(own, 0);
  }

  ceres::Solver::Options options;
  options.linear_solver_type = std::string(argv[2]) == "DENSE_SCHUR"
                                   ? ceres::DENSE_SCHUR
                                   : ceres::SPARSE_SCHUR;
  options.linear_solver_ordering = ordering;
  options.num_threads = std::stoi(argv[3]);
  // The problem is nearly linear: from the default radius of 1e4 it takes four
  // times as many iterations.
  options.initial_trust_region_radius = 1e16;
  options.function_tolerance = std::stod(argv[4]);
  options.gradient_tolerance = 0.0;
  options.parameter_tolerance = 0.0;
  options.max_num_iterations = 200;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  const auto started = std::chrono::steady_clock::now();
  ceres::Solve(options, &problem, &summary);
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - started)
          .count();
  rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  std::printf("result %.6f %zu %.17e %.1f\n", seconds,
              summary.iterations.size(), summary.final_cost,
              usage.ru_maxrss / 1024.0);
  return 0;
}
