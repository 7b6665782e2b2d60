// The value types that an agent uploads and the server keeps: a submap with its keyframes,
// observations, described features and filter landmarks. Plain data; common/wire converts and
// validates it.
//
// Units: pixels are raw (distorted) image coordinates. Lengths are submap units: metres if
// `metric`, else an arbitrary unit that is constant within the submap and, by the conditionally
// independent hand-over, continues over LinkType::kConnected.
#ifndef PORTOLAN_COMMON_SUBMAP_SUBMAP_H_
#define PORTOLAN_COMMON_SUBMAP_SUBMAP_H_

#include <cstdint>
#include <optional>
#include <vector>

#include "common/base/strong_id.h"
#include "common/base/time.h"
#include "common/features/descriptor.h"
#include "common/geodesy/local_frame.h"
#include "common/geometry/rigid3.h"

namespace portolan {

// Globally unique name of a submap. sequence_number counts from 0 in a session.
struct SubmapKey {
  AgentId agent;
  SessionId session;
  uint32_t sequence_number = 0;

  friend bool operator==(const SubmapKey&, const SubmapKey&) = default;
  friend auto operator<=>(const SubmapKey&, const SubmapKey&) = default;
};

// One sight of a track in a keyframe.
struct Observation {
  TrackId track;
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
  float sigma_px = 1.0f;
};

// A described image point of a keyframe, for place recognition and matching. If it lies on a
// track, `track` names it (several features of one track may exist, one an octave).
struct Feature {
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
  // The image was halved this many times (in halves: 1 = scale 1/sqrt(2)) before description.
  uint8_t half_octave = 0;
  std::optional<TrackId> track;
  Descriptor descriptor;
};

struct Keyframe {
  Timestamp time{};
  Rigid3 submap_from_camera;
  // Of the right perturbation [translation; rotation] of submap_from_camera.
  Matrix6d covariance = Matrix6d::Zero();
  // At most one observation a track, ascending track id.
  std::vector<Observation> observations;
  // Empty except for the described keyframes (one to three a submap).
  std::vector<Feature> features;
};

// The filter's estimate of a landmark with known depth. Landmarks whose depth is still unknown
// have observations only.
struct SubmapLandmark {
  TrackId track;
  Eigen::Vector3d point_in_submap = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
};

// The filter's pose at one processed frame (every frame, not only keyframes).
struct FramePose {
  Timestamp time{};
  Rigid3 submap_from_camera;
};

// A position by a satellite receiver, of its antenna.
struct GnssFix {
  Timestamp time{};
  GeodeticPosition position;
  double sigma_horizontal_m = 1;  // of each horizontal coordinate
  double sigma_vertical_m = 1;
};

// How the submap hangs on its predecessor (sequence_number - 1).
enum class LinkType {
  kNone,       // the session's first submap
  kConnected,  // base frame == the predecessor's last keyframe; scale and tracks continue
  kBroken,     // tracking was lost in between; no geometric relation is known
};

struct Submap {
  SubmapKey key;
  LinkType link = LinkType::kNone;
  // Lengths are metres (an IMU, odometry, stereo or range sensor gave the scale).
  bool metric = false;
  // Unit vector of gravity (downwards) in the submap frame, if a sensor gave it.
  std::optional<Eigen::Vector3d> gravity_in_submap;
  // Ascending time. The first one's pose is the identity (it is the submap frame); the last one
  // is the base of a connected successor, whose first keyframe is the same image.
  std::vector<Keyframe> keyframes;
  std::vector<SubmapLandmark> landmarks;  // ascending track id
  std::vector<FramePose> frames;          // ascending time
  // Ascending time, from the first keyframe's up to the last one's.
  std::vector<GnssFix> gnss;
  // Where the receiver's antenna is.
  Eigen::Vector3d antenna_in_camera_m = Eigen::Vector3d::Zero();
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_SUBMAP_SUBMAP_H_
