// What the agent remembers of the map outside of its window: described points of its own earlier
// submaps, at the places that the server's corrections give them.
#ifndef PORTOLAN_AGENT_REVISIT_LANDMARK_MEMORY_H_
#define PORTOLAN_AGENT_REVISIT_LANDMARK_MEMORY_H_

#include <map>
#include <optional>
#include <span>
#include <vector>

#include "agent/revisit/known_landmark.h"
#include "common/base/status.h"
#include "common/bundle/triangulation.h"
#include "common/camera/camera_model.h"
#include "common/geometry/similarity3.h"
#include "common/submap/frame_correction.h"
#include "common/submap/submap.h"

namespace portolan {

struct LandmarkMemoryOptions {
  // Submaps that are remembered; the oldest are forgotten.
  int max_submaps = 150;
  // Of a described track: keyframes that must have seen it.
  int min_sights = 4;
  TriangulationOptions triangulation;

  Status Validate() const;
};

// Thread-compatible, deterministic.
class LandmarkMemory {
 public:
  struct Group {
    ComponentId component;
    std::vector<KnownLandmark> landmarks;
  };

  LandmarkMemory(const LandmarkMemoryOptions& options, const CameraModel& camera)
      : options_(options), camera_(camera) {}

  // A submap of the agent's own that has been closed.
  void AddSubmap(const Submap& submap);
  // The server has placed it: all of its keyframes in ascending time, and the world's units a unit
  // of the submap.
  void Place(uint32_t sequence_number, ComponentId component, double scale,
             std::span<const CorrectedKeyframe> keyframes);

  // What was placed, by sequence number.
  const std::map<uint64_t, Group>& groups() const { return groups_; }
  std::optional<Eigen::Vector3d> PositionOf(const KnownLandmarkId& id) const;

 private:
  // A described track before its submap is placed.
  struct Track {
    std::vector<std::pair<int, Observation>> sights;  // keyframe
    std::vector<Descriptor> descriptors;
    int described_keyframe = -1;
  };
  // Thereafter, in the camera of a keyframe and submap units.
  struct Anchored {
    int keyframe = 0;
    Eigen::Vector3d point_in_camera = Eigen::Vector3d::Zero();
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  };
  struct OwnSubmap {
    std::vector<Track> tracks;
    std::vector<Anchored> anchored;  // parallel to the group's landmarks
  };

  void Triangulate(double scale, std::span<const CorrectedKeyframe> keyframes, OwnSubmap* submap,
                   Group* group) const;

  const LandmarkMemoryOptions options_;
  const CameraModel camera_;
  std::map<uint64_t, OwnSubmap> own_;
  std::map<uint64_t, Group> groups_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_REVISIT_LANDMARK_MEMORY_H_
