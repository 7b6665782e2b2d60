// Second thoughts of MapAligner: waiting closures that contradict the map may be right, and
// closures that were accepted before them wrong.
#include <algorithm>
#include <cstdlib>
#include <map>
#include <memory>
#include <set>
#include <utility>
#include <vector>

#include "common/linear_algebra/dense.h"
#include "server/alignment/map_aligner.h"

namespace portolan {
namespace {

// A keyframe with a smaller share of inliers was pulled away, by a wrong closure that is gone by
// now, so far that the bundle adjustment takes all that it sees for outliers.
constexpr double kMinInliersOfKeyframe = 0.25;

// By keyframe.
std::vector<bool> Strays(const ModelSubmap& submap) {
  std::vector<int> inliers(submap.world_from_camera.size(), 0), all = inliers;
  for (size_t i = 0; i < submap.landmarks.size(); ++i) {
    for (const ModelSight& sight : submap.sights[i]) {
      inliers[sight.keyframe] += sight.inlier ? 1 : 0;
      ++all[sight.keyframe];
    }
  }
  std::vector<bool> strays;
  for (size_t k = 0; k < all.size(); ++k) {
    strays.push_back(inliers[k] < kMinInliersOfKeyframe * all[k]);
  }
  return strays;
}

}  // namespace

void MapAligner::SettleWaiting() {
  // A join turns other closures into loops, and a corrected loop may let others agree.
  while (JoinComponents()) CloseLoops();
  CloseLoops();
}

// Each component is reviewed once for each number of closures that wait in it.
void MapAligner::ReviewClosures() {
  std::map<ComponentId, size_t> contradicting;
  for (const Closure& closure : pending_) {
    const ComponentId component = model_.submap(closure.a).component;
    if (component != model_.submap(closure.b).component || IsLarge(component)) continue;
    ++contradicting[component];
  }
  bool changed = false;
  for (const auto& [component, count] : contradicting) {
    size_t& reviewed = reviewed_counts_[component];
    // A single one is outvoted by what joined the component.
    if (count < 2 || count == reviewed) continue;
    reviewed = count;
    changed = ReviewComponent(component) || changed;
  }
  if (changed) SettleWaiting();
}

bool MapAligner::ReviewComponent(ComponentId component) {
  const std::vector<SubmapId> ids = model_.SubmapsOf(component);
  std::map<SubmapId, int> nodes;
  for (const SubmapId id : ids) nodes.emplace(id, static_cast<int>(nodes.size()));
  std::vector<Relation> relations;
  std::vector<int> support;
  for (const SubmapId id : ids) {
    const auto& link = model_.submap(id).link;
    if (!link) continue;
    relations.push_back(
        {nodes.at(link->a), nodes.at(id), link->a_from_b, link->information, false});
    support.push_back(0);
  }
  std::vector<std::shared_ptr<const Closure>> judged;
  const auto add = [&](const ClosureList& list) {
    for (size_t i = 0; i < list.size(); ++i) {
      const Closure& closure = list[i];
      if (!nodes.contains(closure.a) || !nodes.contains(closure.b)) continue;
      judged.push_back(list.shared(i));
      relations.push_back({nodes.at(closure.a), nodes.at(closure.b), closure.a_from_b,
                           InverseOfPositiveDefinite(relations_.FlooredCovariance(model_, closure)),
                           true});
      support.push_back(static_cast<int>(closure.matches.size()));
    }
  };
  add(closures());
  const size_t accepted_before = judged.size();
  add(pending_);
  const JudgedFleet fleet =
      JudgeClosures(options_.judge, static_cast<int>(ids.size()), relations, support);
  std::set<const Closure*> refused;
  int lost = 0, won = 0;
  const size_t first = relations.size() - judged.size();
  for (size_t i = 0; i < judged.size(); ++i) {
    const bool accepted = fleet.accepted[first + i];
    if (i < accepted_before && !accepted) {
      refused.insert(judged[i].get());
      lost += support[first + i];
    } else if (i >= accepted_before && accepted) {
      won += support[first + i];
    }
  }
  if (refused.empty() || won <= lost) return false;
  for (size_t i = 0; i < accepted_before; ++i) {
    if (refused.contains(judged[i].get())) pending_.push_back(judged[i]);
  }
  relations_.EraseClosures([&](const Closure& closure) { return refused.contains(&closure); });
  PartComponent(component);
  // The links' own measurements again, in place of what the wrong closures bent.
  std::map<ComponentId, Similarity3> world_from_judged;
  for (const SubmapId id : ids) {
    const Similarity3& pose = fleet.world_from_node[nodes.at(id)];
    const ModelSubmap& submap = model_.submap(id);
    const auto [it, is_first] =
        world_from_judged.try_emplace(submap.component, submap.world_from_submap * pose.Inverse());
    if (!is_first) model_.MoveSubmap(id, it->second * pose);
  }
  Touch(ids);
  return true;
}

void MapAligner::SettleComponent(const std::atomic<bool>& interrupt) {
  if (unsettled_.empty()) return;
  const ComponentId component = *unsettled_.begin();
  const std::vector<SubmapId> ids = model_.SubmapsOf(component);
  if (ids.empty() || ids.size() > static_cast<size_t>(options_.settled_component_submaps)) {
    unsettled_.erase(component);
    return;
  }
  UniteAnew(component, ids);
  PositionReferences positions;
  const bool has_positions = Georeference(component, &positions);
  const MapAdjustment adjustment =
      SettleMap(options_.adjuster, ids, &interrupt, &model_, has_positions ? &positions : nullptr);
  Touch(ids);
  ReportErrors(component);
  if (adjustment.summary.interrupted) return;
  unsettled_.erase(component);
  MakeMetric(component);
  if (IsLarge(component)) {
    TakeBackFailed(ids);
  } else {
    ReviseClosures(component);
  }
}

void MapAligner::UniteAnew(ComponentId component, const std::vector<SubmapId>& ids) {
  std::vector<const Closure*> inside;
  for (const Closure& closure : closures()) {
    if (model_.submap(closure.a).component == component) inside.push_back(&closure);
  }
  std::sort(inside.begin(), inside.end(), [](const Closure* one, const Closure* other) {
    return std::pair(one->b, one->a) < std::pair(other->b, other->a);
  });
  model_.SeparateLandmarks(ids);
  for (const Closure* closure : inside) UniteMatches(*closure);
}

bool MapAligner::PutBackStrays(const std::vector<SubmapId>& ids) {
  bool some = false;
  for (const SubmapId id : ids) {
    const ModelSubmap& submap = model_.submap(id);
    std::vector<bool> strays = Strays(submap);
    // A predecessor decides about the keyframe that it shares.
    if (submap.link) strays.front() = false;
    const auto count = std::count(strays.begin(), strays.end(), true);
    if (count == 0 || 2 * count > static_cast<std::ptrdiff_t>(strays.size())) continue;
    if (!put_back_.insert(id).second) continue;
    some = true;
    const std::vector<Rigid3>& refined = submap.refined->submap_from_camera;
    for (int k = 0; k < static_cast<int>(strays.size()); ++k) {
      if (!strays[k]) continue;
      int nearest = -1;
      for (int j = 0; j < static_cast<int>(strays.size()); ++j) {
        if (!strays[j] && (nearest < 0 || std::abs(j - k) < std::abs(nearest - k))) nearest = j;
      }
      Rigid3 step = refined[nearest].Inverse() * refined[k];
      step.translation *= submap.world_from_submap.scale;
      model_.SetCamera(id, k, submap.world_from_camera[nearest] * step);
    }
    for (size_t i = 0; i < submap.landmarks.size(); ++i) {
      for (size_t k = 0; k < submap.sights[i].size(); ++k) {
        if (!strays[submap.sights[i][k].keyframe]) continue;
        model_.SetInlier(id, static_cast<int>(i), static_cast<int>(k), true);
      }
    }
  }
  return some;
}

}  // namespace portolan
