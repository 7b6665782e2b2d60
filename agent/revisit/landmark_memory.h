// What the agent knows of the map outside of its window: described points of its own earlier
// submaps, where the server's corrections put them, and landmarks of others that the server offers.
#ifndef PORTOLAN_AGENT_REVISIT_LANDMARK_MEMORY_H_
#define PORTOLAN_AGENT_REVISIT_LANDMARK_MEMORY_H_

#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "agent/revisit/known_landmark.h"
#include "common/base/status.h"
#include "common/bundle/triangulation.h"
#include "common/camera/camera_model.h"
#include "common/geometry/similarity3.h"
#include "common/submap/frame_correction.h"
#include "common/submap/landmark_offer.h"
#include "common/submap/submap.h"

namespace portolan {

struct LandmarkMemoryOptions {
  // Own submaps and offered views that are remembered, the newest. With their landmarks some 60 and
  // 20 kB each.
  int max_submaps = 200;
  int max_offered_views = 400;
  // Landmarks of one offered view; more are not taken.
  int max_offered_landmarks = 200;
  // Keyframes that must have seen a described track, agreeing on its place.
  int min_sights = 4;
  TriangulationOptions triangulation;

  Status Validate() const;
};

// Landmarks that move together: those of an own submap or of an offered view.
struct KnownGroup {
  ComponentId component;
  std::vector<KnownLandmark> landmarks;
  // Another number says that the landmarks are others than before.
  uint64_t filling = 0;
};

// Thread-compatible, deterministic.
class LandmarkMemory {
 public:
  LandmarkMemory(const LandmarkMemoryOptions& options, const CameraModel& camera)
      : options_(options), camera_(camera) {}

  // From now on with this lens.
  void SetCamera(const CameraModel& camera) { camera_ = camera; }

  // A submap of the agent's own that has been closed.
  void AddSubmap(const Submap& submap);
  // The server has placed it: all of its keyframes in ascending time, and world units a unit of the
  // submap.
  void Place(uint32_t sequence_number, ComponentId component, double scale,
             std::span<const CorrectedKeyframe> keyframes);
  // Landmarks that do not follow on those that are there are left out, the view moves anyhow.
  void AddOffer(const LandmarkOffer& offer);

  // What was placed. Own submaps come first, by sequence number, then the offered views.
  const std::map<KnownGroupId, KnownGroup>& groups() const { return groups_; }
  // In this component's world; no value if it is elsewhere or forgotten.
  std::optional<Eigen::Vector3d> PositionOf(const KnownLandmarkId& id, ComponentId component) const;

 private:
  // A described track before its submap is placed.
  struct Track {
    std::vector<std::pair<int, Observation>> sights;  // with the keyframe
    std::vector<Descriptor> descriptors;
    int described_keyframe = 0;
  };
  // A landmark in the camera that described it, in units of its submap.
  struct Anchored {
    int keyframe = 0;
    Eigen::Vector3d point_in_camera = Eigen::Vector3d::Zero();
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  };
  struct OwnSubmap {
    std::vector<Track> tracks;       // until it is placed
    std::vector<Anchored> anchored;  // parallel to the group's landmarks
  };
  struct OfferedView {
    std::vector<Anchored> anchored;  // parallel to the group's landmarks
    uint64_t received = 0;           // counts the offers
  };

  static void Move(const Anchored& anchored, const Rigid3& world_from_camera, double scale,
                   KnownLandmark* landmark);
  void Triangulate(double scale, std::span<const CorrectedKeyframe> keyframes, OwnSubmap* submap,
                   KnownGroup* group) const;
  // No value if its sights do not agree on a place.
  std::optional<Anchored> AnchorOf(const Track& track, double scale,
                                   std::span<const CorrectedKeyframe> keyframes) const;
  void ForgetOldestView();

  const LandmarkMemoryOptions options_;
  CameraModel camera_;
  std::map<uint32_t, OwnSubmap> own_;
  std::map<KnownGroupId, OfferedView> offered_;
  uint64_t received_ = 0;
  std::map<KnownGroupId, KnownGroup> groups_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_REVISIT_LANDMARK_MEMORY_H_
