#include "tests/accuracy/pose_graph/graph_worlds.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <random>
#include <utility>

namespace portolan {
namespace {

using NodePair = std::pair<int, int>;

constexpr int kTurn = 50;          // poses round the torus' tube
constexpr int kHalfLattice = 9;    // the cube spans [-9, 9] steps
constexpr int kMinLoopLength = 6;  // poses between the ends of a closure

Rigid3 Noise(const GraphWorldOptions& options, std::mt19937* random) {
  std::normal_distribution<double> normal;
  Vector6d noise;
  for (int i = 0; i < 6; ++i) noise[i] = normal(*random);
  noise.head<3>() *= options.sigma_translation;
  noise.tail<3>() *= options.sigma_rotation_rad;
  return Rigid3::Exp(noise);
}

// Chain edges and as many of `closures` as the options ask for, evenly drawn.
GraphWorld MakeWorld(const GraphWorldOptions& options, std::vector<Rigid3> truth,
                     std::vector<NodePair> closures, std::mt19937* random) {
  GraphWorld world;
  world.truth = std::move(truth);
  const int count = static_cast<int>(world.truth.size());
  std::vector<NodePair> pairs;
  for (int i = 0; i + 1 < count; ++i) pairs.emplace_back(i, i + 1);
  std::shuffle(closures.begin(), closures.end(), *random);
  const size_t wanted = static_cast<size_t>(std::max(0, options.edges - count + 1));
  closures.resize(std::min(closures.size(), wanted));
  pairs.insert(pairs.end(), closures.begin(), closures.end());
  for (const auto& [a, b] : pairs) {
    PoseEdge3 edge{a, b, {}, Matrix6d::Identity()};
    edge.a_from_b = world.truth[a].Inverse() * world.truth[b] * Noise(options, random);
    edge.information.diagonal().head<3>().setConstant(1 / std::pow(options.sigma_translation, 2));
    // The error is the quaternion's vector part: half the angle.
    edge.information.diagonal().tail<3>().setConstant(4 / std::pow(options.sigma_rotation_rad, 2));
    world.graph.edges.push_back(edge);
  }
  world.graph.world_from_node = {world.truth[0]};
  for (int i = 0; i < count; ++i) {
    world.graph.ids.push_back(i);
    if (i == 0) continue;
    world.graph.world_from_node.push_back(world.graph.world_from_node.back() *
                                          world.graph.edges[i - 1].a_from_b);
  }
  return world;
}

using Cell = std::array<int, 3>;

Cell CellOf(const Rigid3& pose) {
  Cell cell;
  for (int i = 0; i < 3; ++i) cell[i] = static_cast<int>(std::lround(pose.translation[i]));
  return cell;
}

// One step along x after a random right-angled turn that stays in the cube.
Rigid3 NextOnLattice(const Rigid3& pose, std::mt19937* random) {
  while (true) {
    Eigen::Vector3d turn = Eigen::Vector3d::Zero();
    const unsigned draw = (*random)() % 12;
    if (draw < 4) turn[1 + draw / 2] = (draw % 2 == 0 ? 1 : -1) * M_PI / 2;
    Rigid3 next = pose;
    next.rotation = (pose.rotation * RotationExp(turn)).normalized();
    next.translation += next.rotation * Eigen::Vector3d::UnitX();
    if (next.translation.cwiseAbs().maxCoeff() < kHalfLattice + 0.5) return next;
  }
}

}  // namespace

GraphWorld MakeTorusWorld(const GraphWorldOptions& options) {
  std::mt19937 random(options.seed);
  std::vector<Rigid3> truth;
  std::vector<NodePair> closures;
  const double tube = kTurn / (2 * M_PI), ring = 3 * tube;
  for (int i = 0; i < options.poses; ++i) {
    const double u = 2 * M_PI * i / options.poses, v = 2 * M_PI * i / kTurn;
    const double radius = ring + tube * std::cos(v);
    const Eigen::Vector3d position(radius * std::cos(u), radius * std::sin(u), tube * std::sin(v));
    truth.push_back({RotationExp({0, 0, u}) * RotationExp({0, -v, 0}), position});
    if (i >= kTurn) closures.emplace_back(i - kTurn, i);
  }
  return MakeWorld(options, std::move(truth), std::move(closures), &random);
}

GraphWorld MakeLatticeWorld(const GraphWorldOptions& options) {
  std::mt19937 random(options.seed);
  std::vector<Rigid3> truth = {Rigid3()};
  while (static_cast<int>(truth.size()) < options.poses) {
    truth.push_back(NextOnLattice(truth.back(), &random));
  }
  std::map<Cell, std::vector<int>> visits;
  std::vector<NodePair> closures;
  for (int i = 0; i < options.poses; ++i) {
    const Cell cell = CellOf(truth[i]);
    for (int axis = 0; axis < 3; ++axis) {
      for (const int step : {-1, 0, 1}) {
        if (step == 0 && axis > 0) continue;
        Cell near = cell;
        near[axis] += step;
        for (const int j : visits[near]) {
          if (i - j >= kMinLoopLength) closures.emplace_back(j, i);
        }
      }
    }
    visits[cell].push_back(i);
  }
  return MakeWorld(options, std::move(truth), std::move(closures), &random);
}

}  // namespace portolan
