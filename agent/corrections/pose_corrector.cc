#include "agent/corrections/pose_corrector.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"

namespace portolan {
namespace {

// Should nobody take them.
constexpr std::ptrdiff_t kMaxWaitingOffers = 100;

}  // namespace

void PoseCorrector::OpenSubmap(uint32_t sequence_number,
                               std::optional<Rigid3> predecessor_from_submap) {
  std::unique_lock lock(mutex_);
  submaps_[sequence_number].predecessor_from_submap = predecessor_from_submap;
}

void PoseCorrector::CloseSubmap(const Submap& submap) {
  std::unique_lock lock(mutex_);
  const uint32_t sequence_number = submap.key.sequence_number;
  const auto [at, is_new] = submaps_.try_emplace(sequence_number);
  SubmapRecord& record = at->second;
  if (is_new && submap.link == LinkType::kConnected && at != submaps_.begin()) {
    const auto& [previous_number, previous] = *std::prev(at);
    if (previous_number + 1 == sequence_number && !previous.keyframes.empty()) {
      record.predecessor_from_submap = previous.keyframes.back().submap_from_camera;
    }
  }
  record.keyframes.clear();
  for (const Keyframe& keyframe : submap.keyframes) {
    record.keyframes.push_back({keyframe.time, keyframe.submap_from_camera});
  }
  record.frames = submap.frames;
  record.closed = true;
}

Status PoseCorrector::Apply(const MapCorrection& correction) {
  std::unique_lock lock(mutex_);
  Status status;
  if (!correction.submaps.empty()) ++revision_;
  for (const SubmapPlacement& placement : correction.submaps) {
    const Status one = ApplyOne(placement, correction.map_version);
    if (!one.ok()) status = one;
  }
  map_version_ = std::max(map_version_, correction.map_version);
  offers_.insert(offers_.end(), correction.offers.begin(), correction.offers.end());
  if (std::ssize(offers_) > kMaxWaitingOffers) {
    offers_.erase(offers_.begin(), offers_.end() - kMaxWaitingOffers);
  }
  return status;
}

std::vector<LandmarkOffer> PoseCorrector::TakeOffers() {
  std::unique_lock lock(mutex_);
  return std::exchange(offers_, {});
}

Status PoseCorrector::ApplyOne(const SubmapPlacement& placement, uint64_t map_version) {
  const auto at = submaps_.find(placement.sequence_number);
  if (at == submaps_.end() || !at->second.closed) {
    return absl::InvalidArgumentError(
        absl::StrCat("correction of submap ", placement.sequence_number, ", which is not closed"));
  }
  SubmapRecord& record = at->second;
  const auto& adjusted = placement.adjusted_submap_from_camera;
  if (!adjusted.empty() && adjusted.size() != record.keyframes.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("correction of submap ", placement.sequence_number, " has ", adjusted.size(),
                     " keyframes instead of ", record.keyframes.size()));
  }
  if (map_version < record.placement_version) return absl::OkStatus();
  record.placement = placement;
  record.placement_version = map_version;
  record.placement_revision = revision_;
  record.correction = {placement.world_from_submap, {}};
  for (size_t i = 0; i < adjusted.size(); ++i) {
    record.correction.keyframes.push_back({record.keyframes[i].time,
                                           record.keyframes[i].submap_from_camera,
                                           placement.world_from_submap * adjusted[i]});
  }
  return absl::OkStatus();
}

PoseCorrector::Frame PoseCorrector::WorldFrame(const SubmapRecord& record) {
  Frame frame;
  frame.origin.in_world = true;
  frame.origin.frame_submap = record.placement->sequence_number;
  frame.origin.component = record.placement->component;
  frame.origin.metric = record.placement->metric;
  frame.origin.map_version = record.placement_version;
  frame.frame_from_submap = record.placement->world_from_submap;
  return frame;
}

Similarity3 PoseCorrector::WorldFromLastKeyframe(const SubmapRecord& record) {
  return Similarity3::FromRigid(record.correction.keyframes.back().world_from_camera,
                                record.placement->world_from_submap.scale);
}

PoseCorrector::Frame PoseCorrector::FrameOf(uint32_t sequence_number) const {
  Rigid3 current_from_start;    // maps the submap asked for to the one that the walk has reached
  Rigid3 successor_from_start;  // the same, one step before
  for (uint32_t current = sequence_number;; --current) {
    const auto at = submaps_.find(current);
    if (at != submaps_.end() && at->second.placement.has_value()) {
      Frame frame = WorldFrame(at->second);
      if (current == sequence_number || at->second.correction.keyframes.empty()) {
        frame.frame_from_submap =
            frame.frame_from_submap * Similarity3::FromRigid(current_from_start);
      } else {
        // The successor's frame is the last keyframe's camera: its adjusted pose is the better one.
        frame.frame_from_submap =
            WorldFromLastKeyframe(at->second) * Similarity3::FromRigid(successor_from_start);
      }
      return frame;
    }
    if (at == submaps_.end() || !at->second.predecessor_from_submap.has_value() || current == 0) {
      Frame frame;
      frame.origin.frame_submap = current;
      frame.frame_from_submap = Similarity3::FromRigid(current_from_start);
      return frame;
    }
    successor_from_start = current_from_start;
    current_from_start = *at->second.predecessor_from_submap * current_from_start;
  }
}

std::optional<PoseCorrector::Frame> PoseCorrector::FrameFromYounger(
    uint32_t sequence_number) const {
  Similarity3 younger_from_start;
  for (uint32_t current = sequence_number;; ++current) {
    const auto younger = submaps_.find(current + 1);
    if (younger == submaps_.end() || !younger->second.predecessor_from_submap.has_value()) {
      return std::nullopt;
    }
    younger_from_start =
        Similarity3::FromRigid(younger->second.predecessor_from_submap->Inverse()) *
        younger_from_start;
    if (!younger->second.placement.has_value()) continue;
    Frame frame = WorldFrame(younger->second);
    frame.frame_from_submap = frame.frame_from_submap * younger_from_start;
    return frame;
  }
}

PlacedPose PoseCorrector::Place(uint32_t sequence_number, const Rigid3& submap_from_camera) const {
  std::unique_lock lock(mutex_);
  const Frame frame = FrameOf(sequence_number);
  PlacedPose pose = frame.origin;
  pose.frame_from_camera = frame.frame_from_submap * submap_from_camera;
  return pose;
}

CorrectedSubmap PoseCorrector::Corrected(const SubmapRecord& record) {
  return {WorldFrame(record).origin, record.correction.keyframes, record.placement->added_radial,
          record.placement->world_from_submap.scale};
}

std::optional<CorrectedSubmap> PoseCorrector::NewestPlaced(uint32_t sequence_number) const {
  std::unique_lock lock(mutex_);
  for (uint32_t current = sequence_number;; --current) {
    const auto at = submaps_.find(current);
    if (at == submaps_.end()) return std::nullopt;
    const SubmapRecord& record = at->second;
    if (record.placement && !record.correction.keyframes.empty()) {
      return Corrected(record);
    }
    if (!record.predecessor_from_submap || current == 0) return std::nullopt;
  }
}

std::vector<CorrectedSubmap> PoseCorrector::PlacedSince(uint64_t revision) const {
  std::unique_lock lock(mutex_);
  std::vector<CorrectedSubmap> placed;
  for (const auto& [sequence_number, record] : submaps_) {
    if (!record.placement || record.placement_revision <= revision ||
        record.correction.keyframes.empty()) {
      continue;
    }
    placed.push_back(Corrected(record));
  }
  return placed;
}

std::vector<PlacedFrame> PoseCorrector::Trajectory() const {
  std::unique_lock lock(mutex_);
  std::vector<PlacedFrame> trajectory;
  for (const auto& [sequence_number, record] : submaps_) {
    Frame place = FrameOf(sequence_number);
    if (!place.origin.in_world) place = FrameFromYounger(sequence_number).value_or(place);
    for (const FramePose& frame : record.frames) {
      // The frame at which two submaps meet counts for the older one.
      if (!trajectory.empty() && frame.time <= trajectory.back().time) continue;
      PlacedFrame placed{frame.time, sequence_number, place.origin};
      placed.pose.frame_from_camera =
          record.placement.has_value()
              ? CorrectFrame(record.correction, frame.time, frame.submap_from_camera)
              : place.frame_from_submap * frame.submap_from_camera;
      trajectory.push_back(placed);
    }
  }
  return trajectory;
}

uint64_t PoseCorrector::revision() const {
  std::unique_lock lock(mutex_);
  return revision_;
}

uint64_t PoseCorrector::map_version() const {
  std::unique_lock lock(mutex_);
  return map_version_;
}

}  // namespace portolan
