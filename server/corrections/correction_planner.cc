#include "server/corrections/correction_planner.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace portolan {
namespace {

uint32_t SequenceNumber(const SubmapState& state) {
  return state.refined->raw->key.sequence_number;
}

bool IsMetric(const MapSnapshot& snapshot, ComponentId id) {
  for (const ComponentState& component : snapshot.components) {
    if (component.id == id) return component.metric;
  }
  return false;
}

}  // namespace

Status CorrectionOptions::Validate() const {
  for (const double value :
       {translation_share, rotation_rad, scale_share, bytes_per_second, burst_bytes}) {
    if (!(value > 0)) return absl::InvalidArgumentError("correction options must be positive");
  }
  return absl::OkStatus();
}

double EstimateBytes(const SubmapPlacement& placement) {
  return 120 + 13.0 * static_cast<double>(placement.adjusted_submap_from_camera.size());
}

SubmapPlacement MakePlacement(const SubmapState& state, const MapSnapshot& snapshot) {
  SubmapPlacement placement;
  placement.sequence_number = SequenceNumber(state);
  placement.component = state.component;
  placement.metric = IsMetric(snapshot, state.component);
  placement.world_from_submap = state.world_from_submap;
  placement.covariance_diagonal = state.covariance.diagonal().cwiseMax(0);
  const Similarity3 submap_from_world = state.world_from_submap.Inverse();
  for (const Rigid3& world_from_camera : state.world_from_camera) {
    placement.adjusted_submap_from_camera.push_back(submap_from_world * world_from_camera);
  }
  placement.added_radial = AddedRadial(state);
  return placement;
}

double RelativeMovement(const SubmapState& told, const SubmapState& state, double median_depth,
                        const CorrectionOptions& options) {
  if (told.component != state.component ||
      told.world_from_camera.size() != state.world_from_camera.size()) {
    return std::numeric_limits<double>::infinity();
  }
  const double scale = state.world_from_submap.scale;
  const double depth_in_world = scale * median_depth;
  double movement = std::abs(std::log(scale / told.world_from_submap.scale)) / options.scale_share;
  for (size_t i = 0; i < state.world_from_camera.size(); ++i) {
    const Rigid3& a = told.world_from_camera[i];
    const Rigid3& b = state.world_from_camera[i];
    movement = std::max(
        {movement,
         (a.translation - b.translation).norm() / (depth_in_world * options.translation_share),
         a.rotation.angularDistance(b.rotation) / options.rotation_rad});
  }
  return movement;
}

CorrectionPlanner::CorrectionPlanner(const CorrectionOptions& options)
    : options_(options), budget_bytes_(options.burst_bytes) {}

void CorrectionPlanner::Resume(uint64_t received_map_version, const States& states,
                               uint64_t map_version) {
  // A version that this map never had: the agent comes from another life of the map.
  if (received_map_version > map_version) received_map_version = 0;
  std::erase_if(told_,
                [&](const auto& told) { return told.second.map_version > received_map_version; });
  for (const auto& state : states) {
    if (state->moved_at_version <= received_map_version) {
      told_.try_emplace(SequenceNumber(*state), Told{state, received_map_version});
    }
  }
}

bool CorrectionPlanner::MustTell(const std::shared_ptr<const SubmapState>& state, bool all) {
  const auto told = told_.find(SequenceNumber(*state));
  if (told == told_.end()) return true;
  if (told->second.state == state || (!all && told->second.unchanged == state)) return false;
  double& median_depth = told->second.median_depth;
  if (median_depth == 0) median_depth = MedianDepth(*state->refined);
  const double movement = RelativeMovement(*told->second.state, *state, median_depth, options_);
  if (movement > (all ? 0.0 : 1.0)) return true;
  told->second.unchanged = state;
  return false;
}

void CorrectionPlanner::RefillBudget(Duration now) {
  if (last_refill_) {
    budget_bytes_ =
        std::min(options_.burst_bytes,
                 budget_bytes_ + options_.bytes_per_second * ToSeconds(now - *last_refill_));
  }
  last_refill_ = now;
}

std::optional<MapCorrection> CorrectionPlanner::Next(const States& states,
                                                     const MapSnapshot& snapshot, Duration now,
                                                     bool all) {
  RefillBudget(now);
  has_deferred_ = false;
  MapCorrection correction;
  correction.map_version = snapshot.version;
  for (auto state = states.rbegin(); state != states.rend(); ++state) {
    const bool is_newest = state == states.rbegin();
    if (!MustTell(*state, all)) continue;
    const bool is_new = !told_.contains(SequenceNumber(**state));
    if (!all && !(is_newest && is_new) && budget_bytes_ <= 0) {
      has_deferred_ = true;
      continue;
    }
    SubmapPlacement placement = MakePlacement(**state, snapshot);
    budget_bytes_ -= EstimateBytes(placement);
    told_.insert_or_assign(placement.sequence_number, Told{*state, snapshot.version});
    correction.submaps.push_back(std::move(placement));
  }
  if (correction.submaps.empty()) return std::nullopt;
  std::reverse(correction.submaps.begin(), correction.submaps.end());
  correction.more = has_deferred_;
  return correction;
}

}  // namespace portolan
