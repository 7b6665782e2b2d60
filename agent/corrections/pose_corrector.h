// Puts the agent's poses in the world with the newest corrections of the server.
#ifndef PORTOLAN_AGENT_CORRECTIONS_POSE_CORRECTOR_H_
#define PORTOLAN_AGENT_CORRECTIONS_POSE_CORRECTOR_H_

#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "common/base/status.h"
#include "common/submap/frame_correction.h"
#include "common/submap/map_correction.h"
#include "common/submap/submap.h"

namespace portolan {

// A camera pose outside of its submap.
struct PlacedPose {
  // In the world if in_world, else in the frame of the submap `frame_submap`, the oldest one that
  // connected links lead to; lengths are world units or that submap's units.
  Rigid3 frame_from_camera;
  bool in_world = false;
  uint32_t frame_submap = 0;
  // Of the world; only if in_world.
  ComponentId component;
  bool metric = false;
  uint64_t map_version = 0;
};

struct PlacedFrame {
  Timestamp time{};
  uint32_t sequence_number = 0;
  PlacedPose pose;
};

// A submap that the server has placed, with its keyframes.
struct CorrectedSubmap {
  PlacedPose origin;  // frame_from_camera unused
  std::vector<CorrectedKeyframe> keyframes;
  // SubmapPlacement::added_radial.
  Eigen::Vector2d added_radial = Eigen::Vector2d::Zero();
  // World units a unit of the submap.
  double scale = 1;
};

// Keeps the session's submaps (links, frames, keyframe poses) and the newest correction of each.
// The filter never hears of corrections: they act on its output only, so it stays consistent.
//
// Protocol: OpenSubmap in order of sequence number, CloseSubmap before the submap is uploaded,
// Apply whenever a correction arrives. Thread-safe.
class PoseCorrector {
 public:
  // predecessor_from_submap: where the new submap's frame lies in its predecessor's, in their
  // common units; none if the link is not connected.
  void OpenSubmap(uint32_t sequence_number, std::optional<Rigid3> predecessor_from_submap);
  // Keeps the frames and the keyframes' poses for Trajectory(). Opens the submap if OpenSubmap
  // was not called; a connected one then hangs on its predecessor's last keyframe.
  void CloseSubmap(const Submap& submap);

  // Takes what is usable and newer than what is there. InvalidArgument names what was not usable:
  // submaps that are not closed, wrong numbers of keyframes.
  Status Apply(const MapCorrection& correction);

  // The landmarks that the server has offered since the last call, in order of arrival.
  std::vector<LandmarkOffer> TakeOffers();

  // The pose by the newest correction of the submap or of the nearest older submap that connected
  // links lead to; without one, in the odometry frame.
  PlacedPose Place(uint32_t sequence_number, const Rigid3& submap_from_camera) const;

  // The newest submap with adjusted keyframes that connected links lead to from this one, itself
  // included.
  std::optional<CorrectedSubmap> NewestPlaced(uint32_t sequence_number) const;

  // The submaps with adjusted keyframes whose placement came after this revision().
  std::vector<CorrectedSubmap> PlacedSince(uint64_t revision) const;

  // All frames of the closed submaps in ascending time, each once. A submap without correction
  // is placed over connected links by its nearest older, else its nearest younger neighbour.
  std::vector<PlacedFrame> Trajectory() const;

  // Counts the corrections that placed submaps; a map version may come in several. 0: none yet.
  uint64_t revision() const;
  // Newest map version that was applied; 0 if none.
  uint64_t map_version() const;

 private:
  struct SubmapRecord {
    std::optional<Rigid3> predecessor_from_submap;
    std::vector<FramePose> keyframes;  // times and filter poses
    std::vector<FramePose> frames;
    bool closed = false;
    std::optional<SubmapPlacement> placement;
    SubmapCorrection correction;  // of placement
    uint64_t placement_version = 0;
    uint64_t placement_revision = 0;
  };
  // A submap's frame in the world, or in the odometry frame.
  struct Frame {
    PlacedPose origin;  // frame_from_camera unused
    Similarity3 frame_from_submap;
  };

  Status ApplyOne(const SubmapPlacement& placement, uint64_t map_version)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  Frame FrameOf(uint32_t sequence_number) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::optional<Frame> FrameFromYounger(uint32_t sequence_number) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  static Frame WorldFrame(const SubmapRecord& record);
  // Of a placed one.
  static CorrectedSubmap Corrected(const SubmapRecord& record);
  // The placement of the camera at the submap's last keyframe, where a connected successor hangs.
  static Similarity3 WorldFromLastKeyframe(const SubmapRecord& record);

  mutable std::mutex mutex_;
  std::map<uint32_t, SubmapRecord> submaps_ ABSL_GUARDED_BY(mutex_);
  uint64_t map_version_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t revision_ ABSL_GUARDED_BY(mutex_) = 0;
  std::vector<LandmarkOffer> offers_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_CORRECTIONS_POSE_CORRECTOR_H_
