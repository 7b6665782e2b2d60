// The map aligner's work in large components: everything is bounded to a region.
#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "common/linear_algebra/dense.h"
#include "server/alignment/map_aligner.h"

namespace portolan {
namespace {

// Relative movement (of the submap's scale and of its distance in units of its own size) under
// which a solved submap has not moved.
constexpr double kMinMovement = 1e-4;
// ... and above which its neighbours are adjusted again.
constexpr double kRestlessMovement = 1e-3;

// Of a submap to a new place, relative to its own size.
double Movement(const ModelSubmap& submap, const Similarity3& world_from_submap) {
  const double size =
      (submap.world_from_camera.back().translation - submap.world_from_submap.translation).norm();
  const Vector7d step = (submap.world_from_submap.Inverse() * world_from_submap).Log();
  return std::max({step.head<3>().norm() * submap.world_from_submap.scale / std::max(size, 1e-9),
                   step.segment<3>(3).norm(), std::abs(step[6])});
}

}  // namespace

void MapAligner::MoveRegion(const std::vector<SubmapId>& region,
                            const std::vector<Similarity3>& world_from_submap) {
  for (size_t i = 0; i < region.size(); ++i) {
    const ModelSubmap& submap = model_.submap(region[i]);
    const double movement = Movement(submap, world_from_submap[i]);
    if (movement < kMinMovement) continue;
    model_.MoveSubmap(region[i], world_from_submap[i]);
    moved_.insert(region[i]);
    // The cameras shared with the neighbours moved with it.
    if (submap.link) moved_.insert(submap.link->a);
    MarkStale(region[i], 1);
  }
}

std::vector<SubmapId> MapAligner::RegionAround(const std::vector<SubmapId>& seeds,
                                               size_t count) const {
  std::vector<SubmapId> region = seeds;
  std::set<SubmapId> known(seeds.begin(), seeds.end());
  for (size_t i = 0; i < region.size() && region.size() < count; ++i) {
    const SubmapId id = region[i];
    const ModelSubmap& submap = model_.submap(id);
    std::vector<SubmapId> names;
    if (submap.link) names.push_back(submap.link->a);
    if (submap.successor) names.push_back(*submap.successor);
    std::vector<size_t> order = relations_.ClosuresOf(id);
    std::stable_sort(order.begin(), order.end(), [this](size_t a, size_t b) {
      return closures()[a].matches.size() > closures()[b].matches.size();
    });
    for (const size_t k : order) {
      names.push_back(closures()[k].a == id ? closures()[k].b : closures()[k].a);
    }
    for (const SubmapId name : names) {
      if (region.size() >= count) break;
      if (known.insert(name).second) region.push_back(name);
    }
  }
  return region;
}

void MapAligner::AdjustRegion(const std::atomic<bool>& interrupt) {
  if (relaxing_ != nullptr) {
    Relax(relaxing_->component, interrupt);
    return;
  }
  const bool is_all_else_done = restless_.empty() && strained_.empty();
  if (!unjudged_.empty() && (solving_credit_ > 0 || is_all_else_done)) {
    JudgeUnjudged([&] { return !interrupt && (solving_credit_ > 0 || is_all_else_done); });
    solving_credit_ = std::max<int64_t>(solving_credit_, 0);
    return;
  }
  if (restless_.empty()) {
    if (!strained_.empty()) Relax(*strained_.begin(), interrupt);
    return;
  }
  const SubmapId seed =
      std::max_element(restless_.begin(), restless_.end(), [](const auto& a, const auto& b) {
        return a.second < b.second;
      })->first;
  const ComponentId component = model_.submap(seed).component;
  size_t& checked_size = metric_checked_size_[component];
  if (10 * model_.SizeOf(component) > 11 * checked_size) {
    checked_size = model_.SizeOf(component);
    MakeMetric(component);
  }
  if (HasGrown(component)) {
    Relax(component, interrupt);
    if (interrupt) return;
  }
  std::vector<SubmapId> region = RegionAround({seed}, options_.region_submaps);
  std::sort(region.begin(), region.end());
  std::vector<Similarity3> before;
  for (const SubmapId id : region) before.push_back(model_.submap(id).world_from_submap);
  const MapAdjustment adjustment = AdjustMap(options_.adjuster, region, 2, &interrupt, &model_);
  for (size_t i = 0; i < region.size(); ++i) {
    const SubmapId id = region[i];
    if (Movement(model_.submap(id), before[i]) > kRestlessMovement) {
      for (const SubmapId name : relations_.NeighbourNames(model_, id)) {
        if (std::binary_search(region.begin(), region.end(), name)) continue;
        if (visits_[name] < options_.max_region_visits) MarkStale(name, 1);
      }
    }
    touched_.insert(id);
    const ModelSubmap& submap = model_.submap(id);
    if (submap.link) touched_.insert(submap.link->a);
    if (submap.successor) touched_.insert(*submap.successor);
    TouchLandmarksOf(id);
  }
  if (adjustment.summary.interrupted) return;
  restless_.erase(seed);
  ++visits_[seed];
  // So are the seed's neighbours, and whoever else had all of its own about it.
  const std::vector<SubmapId> neighbours = relations_.NeighbourNames(model_, seed);
  const auto is_in_region = [&region](SubmapId name) {
    return std::binary_search(region.begin(), region.end(), name);
  };
  for (const SubmapId id : region) {
    const std::vector<SubmapId> around = relations_.NeighbourNames(model_, id);
    if (std::find(neighbours.begin(), neighbours.end(), id) != neighbours.end() ||
        std::all_of(around.begin(), around.end(), is_in_region)) {
      restless_.erase(id);
    }
  }
  strained_.insert(component);
  TakeBackFailed(region);
}

bool MapAligner::HasGrown(ComponentId component) const {
  const auto relaxed = relaxed_.find(component);
  if (relaxed == relaxed_.end()) return true;
  const auto has_grown = [this](size_t now, size_t before) {
    return static_cast<double>(now) > options_.relaxing_growth * static_cast<double>(before);
  };
  return has_grown(model_.SizeOf(component), relaxed->second.submaps) ||
         has_grown(closures().size(), relaxed->second.closures);
}

void MapAligner::BeginRelaxation(ComponentId component) {
  PositionReferences positions;
  const bool has_positions = Georeference(component, &positions);
  relaxing_ = std::make_unique<Relaxing>();
  relaxing_->component = component;
  relaxing_->closures = closures().size();
  const std::vector<SubmapId> ids = model_.SubmapsOf(component);
  for (const SubmapId id : ids) {
    relaxing_->before.emplace(id, model_.submap(id).world_from_submap);
  }
  relaxing_->relaxation =
      std::make_unique<MapRelaxation>(options_.relaxation, options_.adjuster.metric, ids, model_,
                                      has_positions ? &positions.terms : nullptr);
}

void MapAligner::TakeRelaxation() {
  std::map<SubmapId, Similarity3> moved = relaxing_->relaxation->ApplyTo(&model_);
  std::vector<SubmapId> left;
  for (const SubmapId id : model_.SubmapsOf(relaxing_->component)) {
    moved_.insert(id);
    if (!moved.contains(id)) left.push_back(id);
  }
  for (size_t before = 0; left.size() != before;) {
    before = left.size();
    std::erase_if(left, [&](SubmapId id) {
      for (const SubmapId name : relations_.NeighbourNames(model_, id)) {
        const auto neighbour = moved.find(name);
        if (neighbour == moved.end()) continue;
        const Similarity3 change = neighbour->second;
        const ModelSubmap& submap = model_.submap(id);
        const Rigid3 first = submap.world_from_camera.front();
        model_.MoveSubmap(id, change * submap.world_from_submap);
        // The keyframe shared with a predecessor that was relaxed had moved with that one.
        if (submap.link && relaxing_->before.contains(submap.link->a)) {
          const auto [owner, keyframe] = model_.CameraOf(id, 0);
          model_.SetCamera(owner, keyframe, first);
        }
        moved.emplace(id, change);
        return true;
      }
      return false;
    });
  }
}

void MapAligner::CancelRelaxation(ComponentId component) {
  if (relaxing_ != nullptr && relaxing_->component == component) relaxing_.reset();
}

void MapAligner::Relax(ComponentId component, const std::atomic<bool>& interrupt) {
  if (relaxing_ == nullptr) BeginRelaxation(component);
  if (!relaxing_->relaxation->Run(model_, &interrupt)) return;
  const RelaxationSummary summary = relaxing_->relaxation->summary();
  if (summary.iterations > 0) TakeRelaxation();
  const std::unique_ptr<Relaxing> done = std::exchange(relaxing_, nullptr);
  component = done->component;
  const std::map<SubmapId, Similarity3>& before = done->before;
  if (summary.iterations > 0) JudgeAgain(component);
  ReportErrors(component);
  strained_.erase(component);
  for (const auto& [id, pose] : before) visits_.erase(id);
  const Relaxed now{before.size(), done->closures, summary.final_cost};
  const Relaxed last = std::exchange(relaxed_[component], now);
  unsettled_.insert(component);
  // The regions' inliers differ from those here: of the same map, only what this and the regions
  // gain together counts.
  const double enough = 1 - options_.relaxation.min_decrease;
  const bool is_same = last.submaps == now.submaps && last.closures == now.closures;
  if (now.cost > enough * (is_same ? last.cost : summary.initial_cost)) return;
  // What bent between neighbours is for the regions to adjust.
  for (const auto& [id, pose] : before) {
    const Similarity3 change = model_.submap(id).world_from_submap * pose.Inverse();
    for (const SubmapId name : relations_.NeighbourNames(model_, id)) {
      const auto neighbour = before.find(name);
      if (neighbour == before.end()) continue;
      const Similarity3 carried = change * neighbour->second;
      if (Movement(model_.submap(name), carried) > kRestlessMovement) MarkStale(id, 1);
    }
  }
}

void MapAligner::TakeBackFailed(const std::vector<SubmapId>& region) {
  std::vector<std::shared_ptr<const Closure>> failed;
  for (const SubmapId id : region) {
    for (const size_t i : relations_.ClosuresOf(id)) {
      const Closure& closure = closures()[i];
      if (closure.b != id || !std::binary_search(region.begin(), region.end(), closure.a)) continue;
      if (!Survives(closure)) failed.push_back(closures().shared(i));
    }
  }
  if (failed.empty()) return;
  relations_.EraseClosures([&](const Closure& closure) {
    return std::any_of(failed.begin(), failed.end(),
                       [&](const auto& one) { return one.get() == &closure; });
  });
  for (const auto& closure : failed) {
    const ComponentId component = model_.submap(closure->a).component;
    if (component == model_.submap(closure->b).component && !Relative(closure->a, closure->b)) {
      PartComponent(component);
    } else {
      SeparateMatches(*closure);
    }
    MarkStale(closure->a, 2);
    MarkStale(closure->b, 2);
    // Of a map that was bent at the time even a right one fails: it waits for the next relaxation.
    if (!failed_once_.emplace(closure->a, closure->b).second) continue;
    if (model_.submap(closure->a).component == model_.submap(closure->b).component) {
      seen_[closure.get()] = Disagreement(*closure);
    }
    pending_.push_back(closure);
  }
}

// What the closure united comes apart, but for what other closures hold together.
void MapAligner::SeparateMatches(const Closure& closure) {
  const ModelSubmap& submap = model_.submap(closure.a);
  for (const LandmarkMatch& match : closure.matches) {
    const int in_a = MapModel::LandmarkIndex(*submap.refined, match.in_a);
    if (in_a < 0) continue;
    const std::vector<LandmarkSight> sights = model_.landmarks()[submap.landmarks[in_a]].sights;
    model_.SeparateLandmark(submap.landmarks[in_a]);
    for (const LandmarkSight& sight : sights) {
      for (const size_t i : relations_.ClosuresOf(sight.submap)) {
        const Closure& other = closures()[i];
        for (const LandmarkMatch& pair : other.matches) {
          if (sight == LandmarkSight{other.a, pair.in_a} ||
              sight == LandmarkSight{other.b, pair.in_b}) {
            model_.UniteLandmarks({other.a, pair.in_a}, {other.b, pair.in_b});
          }
        }
      }
    }
    for (const LandmarkSight& sight : sights) TouchLandmark(sight);
  }
}

// The owner of the landmark, and the sight, which may have been or become the owner.
void MapAligner::TouchLandmark(const LandmarkSight& sight) {
  const ModelSubmap& submap = model_.submap(sight.submap);
  const int index = MapModel::LandmarkIndex(*submap.refined, sight.track);
  if (index < 0) return;
  const LandmarkSight& owner = model_.landmarks()[submap.landmarks[index]].sights.front();
  touched_landmarks_[owner.submap].insert(owner.track);
  touched_landmarks_[sight.submap].insert(sight.track);
}

void MapAligner::TouchLandmarksOf(SubmapId id) {
  for (const int landmark : model_.submap(id).landmarks) {
    const LandmarkSight& owner = model_.landmarks()[landmark].sights.front();
    if (owner.submap != id) touched_landmarks_[owner.submap].insert(owner.track);
  }
}

}  // namespace portolan
