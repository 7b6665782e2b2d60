// The pose that the agent tells at once: the server's newest correction, and from there on the
// local adjustment's motion, which holds on to what the agent sees of the map again.
#ifndef PORTOLAN_AGENT_LOCAL_ADJUSTMENT_LIVE_LOCALIZER_H_
#define PORTOLAN_AGENT_LOCAL_ADJUSTMENT_LIVE_LOCALIZER_H_

#include <optional>
#include <span>

#include "agent/corrections/pose_corrector.h"
#include "agent/local_adjustment/local_adjustment.h"
#include "agent/local_adjustment/row_motion.h"
#include "agent/revisit/revisit_options.h"

namespace portolan {

// A frame as the filter left it.
struct LiveFrame {
  Timestamp time{};
  uint32_t sequence_number = 0;
  bool begins_submap = false;
  // Of a connected submap that begins.
  std::optional<Rigid3> predecessor_from_submap;
  Rigid3 submap_from_camera;
  bool tracked = false;
  bool is_keyframe = false;
  // FrameResult::restated.
  std::span<const FramePose> restated;
  // Ascending track id.
  std::span<const LiveSight> sights;
  // Of a keyframe that is to be searched for landmarks of the map: its described tracks.
  std::span<const Feature> features;
};

// Protocol: AddSubmap for every submap of the agent that is closed; Localize for every frame in
// order of time, after the corrector was told of its submap. Thread-compatible.
class LiveLocalizer {
 public:
  LiveLocalizer(const LocalAdjustmentOptions& options, const RevisitOptions& revisit,
                const CameraModel& camera)
      : calibration_(camera),
        window_(options, camera),
        row_motion_(camera.height_px()),
        memory_(revisit.memory, camera),
        matcher_(revisit.matcher, camera),
        remembers_(revisit.enabled) {}

  void AddSubmap(const Submap& submap) {
    if (remembers_) memory_.AddSubmap(submap);
  }

  // Where the frame is by all that is known now.
  PlacedPose Localize(const LiveFrame& frame, PoseCorrector* corrector);

 private:
  // Puts the window in the world again if the server has told something new.
  void FollowCorrections(uint32_t sequence_number, const PoseCorrector& corrector);
  // Takes in what the server has told of other submaps.
  void Learn(PoseCorrector* corrector);

  const CameraModel calibration_;
  LocalAdjustment window_;
  RowMotion row_motion_;
  LandmarkMemory memory_;
  LandmarkMatcher matcher_;
  const bool remembers_;
  // Of the first of the connected submaps.
  Rigid3 odometry_from_submap_;
  Timestamp last_located_{};
  std::optional<Timestamp> last_keyframe_;
  std::vector<LiveSight> sights_;
  // As the server has told it last.
  Eigen::Vector2d added_radial_ = Eigen::Vector2d::Zero();
  // The correction that holds the window.
  std::optional<PlacedPose> held_;
  // PoseCorrector::revision() of what the window, and what memory_, has heard of.
  uint64_t followed_revision_ = 0;
  uint64_t learnt_revision_ = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_LOCAL_ADJUSTMENT_LIVE_LOCALIZER_H_
