#include "server/query/landmark_index.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <queue>
#include <utility>

namespace portolan {
namespace {

struct Candidate {
  double squared_distance;
  const FusedLandmark* landmark;

  friend bool operator<(const Candidate& a, const Candidate& b) {
    return std::pair(a.squared_distance, a.landmark->id) <
           std::pair(b.squared_distance, b.landmark->id);
  }
};

std::vector<const FusedLandmark*> InOrder(std::vector<Candidate> candidates) {
  std::sort(candidates.begin(), candidates.end());
  std::vector<const FusedLandmark*> landmarks;
  landmarks.reserve(candidates.size());
  for (const Candidate& candidate : candidates) landmarks.push_back(candidate.landmark);
  return landmarks;
}

}  // namespace

std::shared_ptr<const LandmarkIndex::Block> LandmarkIndex::MakeBlock(
    std::shared_ptr<const SubmapState> state) {
  auto block = std::make_shared<Block>();
  block->points.reserve(state->landmarks.size());
  double largest = 0;
  for (const FusedLandmark& landmark : state->landmarks) {
    block->bounds.extend(landmark.point_in_world);
    block->points.push_back(landmark.point_in_world.cast<float>());
    largest = std::max(largest, landmark.point_in_world.cwiseAbs().maxCoeff());
  }
  block->rounding = static_cast<float>(largest * 1.2e-7);
  block->component = state->component;
  block->state = std::move(state);
  return block;
}

std::shared_ptr<const LandmarkIndex> LandmarkIndex::Build(
    std::shared_ptr<const MapSnapshot> snapshot, const LandmarkIndex* previous) {
  auto index = std::make_shared<LandmarkIndex>();
  index->blocks_.resize(snapshot->submaps.size());
  ComponentBlocks* component = nullptr;
  ComponentId component_id;
  for (size_t i = 0; i < snapshot->submaps.size(); ++i) {
    const std::shared_ptr<const SubmapState>& state = snapshot->submaps[i];
    std::shared_ptr<const Block>& block = index->blocks_[i];
    if (previous && i < previous->blocks_.size() && previous->snapshot_->submaps[i] == state) {
      block = previous->blocks_[i];
    } else if (!state->landmarks.empty()) {
      block = MakeBlock(state);
    }
    if (!block) continue;
    if (component == nullptr || component_id != block->component) {
      component_id = block->component;
      component = &index->components_[component_id];
    }
    component->blocks.push_back({block->bounds, block.get()});
    component->landmark_count += block->points.size();
  }
  index->snapshot_ = std::move(snapshot);
  return index;
}

const std::vector<LandmarkIndex::BoundedBlock>& LandmarkIndex::BlocksOf(
    ComponentId component) const {
  static const std::vector<BoundedBlock> kNone;
  const auto found = components_.find(component);
  return found == components_.end() ? kNone : found->second.blocks;
}

ComponentId LandmarkIndex::LargestComponent() const {
  ComponentId largest(0);
  size_t largest_count = 0;
  for (const auto& [id, component] : components_) {
    if (component.landmark_count > largest_count) {
      largest = id;
      largest_count = component.landmark_count;
    }
  }
  return largest;
}

std::vector<const FusedLandmark*> LandmarkIndex::InBox(ComponentId component,
                                                       const Eigen::Vector3d& min,
                                                       const Eigen::Vector3d& max,
                                                       const LandmarkFilter& filter) const {
  const Eigen::AlignedBox3d box(min, max);
  std::vector<const FusedLandmark*> found;
  for (const auto& [bounds, block] : BlocksOf(component)) {
    if (!box.intersects(bounds)) continue;
    const Eigen::Vector3f low = min.cast<float>().array() - 2 * block->rounding;
    const Eigen::Vector3f high = max.cast<float>().array() + 2 * block->rounding;
    for (size_t i = 0; i < block->points.size(); ++i) {
      const Eigen::Vector3f& point = block->points[i];
      if ((point.array() < low.array()).any() || (point.array() > high.array()).any()) continue;
      const FusedLandmark& landmark = block->state->landmarks[i];
      if (landmark.observation_count < filter.min_observation_count) continue;
      if (box.contains(landmark.point_in_world)) found.push_back(&landmark);
    }
  }
  std::sort(found.begin(), found.end(),
            [](const FusedLandmark* a, const FusedLandmark* b) { return a->id < b->id; });
  return found;
}

std::vector<const FusedLandmark*> LandmarkIndex::InSphere(ComponentId component,
                                                          const Eigen::Vector3d& center,
                                                          double radius,
                                                          const LandmarkFilter& filter) const {
  const Eigen::Vector3f rough_center = center.cast<float>();
  const float center_rounding = static_cast<float>(center.cwiseAbs().maxCoeff() * 1.2e-7);
  std::vector<Candidate> found;
  for (const auto& [bounds, block] : BlocksOf(component)) {
    if (bounds.squaredExteriorDistance(center) > radius * radius) continue;
    const float limit =
        static_cast<float>(radius) * 1.000001f + 4 * (block->rounding + center_rounding);
    for (size_t i = 0; i < block->points.size(); ++i) {
      if ((block->points[i] - rough_center).squaredNorm() > limit * limit) continue;
      const FusedLandmark& landmark = block->state->landmarks[i];
      if (landmark.observation_count < filter.min_observation_count) continue;
      const double squared_distance = (landmark.point_in_world - center).squaredNorm();
      if (squared_distance <= radius * radius) found.push_back({squared_distance, &landmark});
    }
  }
  return InOrder(std::move(found));
}

std::vector<const FusedLandmark*> LandmarkIndex::Nearest(ComponentId component,
                                                         const Eigen::Vector3d& point, size_t count,
                                                         const LandmarkFilter& filter) const {
  if (count == 0) return {};
  // A heap by the distance of their bounds, the nearest on top: only a few are ever taken.
  std::vector<std::pair<double, const Block*>> blocks;
  for (const auto& [bounds, block] : BlocksOf(component)) {
    blocks.emplace_back(bounds.squaredExteriorDistance(point), block);
  }
  std::make_heap(blocks.begin(), blocks.end(), std::greater<>());
  const Eigen::Vector3f rough_point = point.cast<float>();
  const float point_rounding = static_cast<float>(point.cwiseAbs().maxCoeff() * 1.2e-7);
  std::priority_queue<Candidate> nearest;  // the farthest on top
  for (; !blocks.empty(); blocks.pop_back()) {
    std::pop_heap(blocks.begin(), blocks.end(), std::greater<>());
    const auto [squared_distance, block] = blocks.back();
    const bool is_full = nearest.size() == count;
    if (is_full && squared_distance > nearest.top().squared_distance) break;
    const float margin = 4 * (block->rounding + point_rounding);
    for (size_t i = 0; i < block->points.size(); ++i) {
      if (nearest.size() == count) {
        const float limit =
            std::sqrt(static_cast<float>(nearest.top().squared_distance)) * 1.000001f + margin;
        if ((block->points[i] - rough_point).squaredNorm() > limit * limit) continue;
      }
      const FusedLandmark& landmark = block->state->landmarks[i];
      if (landmark.observation_count < filter.min_observation_count) continue;
      const Candidate candidate{(landmark.point_in_world - point).squaredNorm(), &landmark};
      if (nearest.size() == count) {
        if (!(candidate < nearest.top())) continue;
        nearest.pop();
      }
      nearest.push(candidate);
    }
  }
  std::vector<Candidate> found;
  for (; !nearest.empty(); nearest.pop()) found.push_back(nearest.top());
  return InOrder(std::move(found));
}

std::shared_ptr<const LandmarkIndex> LandmarkIndexCache::Get(
    std::shared_ptr<const MapSnapshot> snapshot) {
  const std::lock_guard lock(mutex_);
  if (!index_ || &index_->snapshot() != snapshot.get()) {
    index_ = LandmarkIndex::Build(std::move(snapshot), index_.get());
  }
  return index_;
}

}  // namespace portolan
