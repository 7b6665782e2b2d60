// The working copy of the global map that the alignment changes: submaps in their components,
// cameras and landmarks in the world, and which sight belongs to which landmark.
#ifndef PORTOLAN_SERVER_ALIGNMENT_MAP_MODEL_H_
#define PORTOLAN_SERVER_ALIGNMENT_MAP_MODEL_H_

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "server/alignment/landmark_sight.h"
#include "server/alignment/submap_link.h"
#include "server/refinement/refined_submap.h"

namespace portolan {

struct MapModelOptions {
  // Tracks that meet in one keyframe farther apart than this are not one landmark.
  double max_conflict_px = 4.0;
  // Squared error in sigmas up to which an observation agrees with its refined landmark.
  double agreeing_chi2 = 16.0;

  Status Validate() const;
};

// Where a landmark of a submap is seen.
struct ModelSight {
  // A raw submap has at most 256 keyframes of at most 4,096 observations; four bytes, for there are
  // thousands a submap.
  uint16_t observation = 0;  // in the raw keyframe
  uint16_t keyframe : 15 = 0;
  bool inlier : 1 = true;
};
static_assert(sizeof(ModelSight) == 4);

// The sights of a submap's landmarks, one list each, ascending keyframe; in one piece, for there
// are thousands a submap.
class SightTable {
 public:
  SightTable() = default;
  // `sights` by ascending keyframe; landmark_of[i] < landmark_count is whose sights[i] is.
  SightTable(size_t landmark_count, const std::vector<ModelSight>& sights,
             const std::vector<int>& landmark_of);

  std::span<const ModelSight> operator[](size_t landmark) const {
    return {sights_.data() + first_[landmark], sights_.data() + first_[landmark + 1]};
  }
  void SetInlier(size_t landmark, size_t sight, bool inlier) {
    sights_[first_[landmark] + sight].inlier = inlier;
  }

 private:
  std::vector<uint32_t> first_;  // by landmark, and the end
  std::vector<ModelSight> sights_;
};

struct ModelLandmark {
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  // Ascending; the tracks that show it. Empty: the slot is free.
  std::vector<LandmarkSight> sights;
};

struct ModelSubmap {
  std::shared_ptr<const RefinedSubmap> refined;
  ComponentId component;
  Similarity3 world_from_submap;
  std::vector<Rigid3> world_from_camera;
  // refined->camera with the lens as the map has found it; one for all submaps of the session, in
  // whatever components.
  std::shared_ptr<const CameraModel> camera;
  // Connected neighbours of the session; the shared keyframe is the predecessor's last and this
  // one's first.
  std::optional<SubmapRelation> link;  // a: the predecessor
  std::optional<SubmapId> successor;
  // Parallel to refined->landmarks: index of the global landmark, and the sights. The shared
  // keyframe's sights belong to the predecessor where it has the track.
  std::vector<int> landmarks;
  SightTable sights;

  bool quarantined() const { return !refined->quarantine_reason.empty(); }
};

// What a stored map knows about a submap.
struct PlacedSubmap {
  std::shared_ptr<const RefinedSubmap> refined;
  ComponentId component;
  Similarity3 world_from_submap;
  std::vector<Rigid3> world_from_camera;      // parallel to the keyframes
  std::shared_ptr<const CameraModel> camera;  // null: refined->camera
};

// Thread-compatible value. Ids of submaps that are passed in are in the model.
class MapModel {
 public:
  explicit MapModel(const MapModelOptions& options) : options_(options) {}

  bool Contains(SubmapId id) const { return submaps_.contains(id); }
  const ModelSubmap& submap(SubmapId id) const { return submaps_.at(id); }
  const std::map<SubmapId, ModelSubmap>& submaps() const { return submaps_; }
  const std::vector<ModelLandmark>& landmarks() const { return landmarks_; }
  // Ascending.
  std::vector<SubmapId> SubmapsOf(ComponentId component) const;
  size_t SizeOf(ComponentId component) const;

  // The component with most submaps of a submap's session, the oldest of such: its lens is theirs.
  ComponentId MainComponentOf(SubmapId id) const;

  // Adds a submap: behind its predecessor if there is a link, else as a component of its own.
  void Add(std::shared_ptr<const RefinedSubmap> refined, const std::optional<SubmapRelation>& link);
  // Adds a submap as it was placed before; the predecessor, if linked, is there.
  void Restore(const PlacedSubmap& placed, const std::optional<SubmapRelation>& link);
  // Sets the position of a landmark that was there before and unites its sights; those of unknown
  // submaps or tracks are left out.
  void RestoreLandmark(const ModelLandmark& known);

  // Moves all of a component into another one's world and names it so.
  void MoveComponent(ComponentId from, ComponentId to, const Similarity3& to_from_from);
  // Places a submap anew; its cameras and the landmarks whose oldest sight is its own go along.
  void MoveSubmap(SubmapId id, const Similarity3& world_from_submap);
  // Splits a component: `part` leaves with a name of its own. No landmark may span both; call
  // SeparateLandmarks first.
  void NamePart(const std::vector<SubmapId>& part, ComponentId name);
  // Undoes the unions of one landmark but those of linked neighbours; its sights keep the position.
  void SeparateLandmark(int index);
  // Undoes all unions among these submaps but those of linked neighbours.
  void SeparateLandmarks(const std::vector<SubmapId>& submaps);

  // Unites the landmarks of two sights. False if a keyframe sees both apart, or a sight is unknown.
  bool UniteLandmarks(const LandmarkSight& a, const LandmarkSight& b);

  // The camera that stands for keyframe k of a submap: the predecessor's for a shared one.
  std::pair<SubmapId, int> CameraOf(SubmapId id, int keyframe) const;
  // Sets a camera's pose, in both submaps for a shared one. (id, keyframe) is a CameraOf().
  void SetCamera(SubmapId id, int keyframe, const Rigid3& world_from_camera);
  // Puts a submap's redundant keyframes where their neighbours are: each neighbour carries them as
  // in the refined submap, and the way between the two tells how much each counts.
  void CarryRedundantKeyframes(SubmapId id);
  // The lens of a session, whose submaps this is one of, from now on.
  void SetCameraModel(SubmapId id, std::shared_ptr<const CameraModel> camera);
  void SetLandmark(int index, const Eigen::Vector3d& point_in_world) {
    landmarks_[index].point_in_world = point_in_world;
  }
  void SetInlier(SubmapId id, int landmark, int sight, bool inlier) {
    submaps_.at(id).sights.SetInlier(landmark, sight, inlier);
  }
  // Sets world_from_submap to what the cameras and landmarks say: the first camera's pose, and the
  // median ratio of the landmarks' distances from it.
  void FitSubmapToCameras(SubmapId id);

  // Position of a track among refined->landmarks; -1 if it has none.
  static int LandmarkIndex(const RefinedSubmap& refined, TrackId track);

 private:
  struct Session {
    std::shared_ptr<const CameraModel> camera;
    std::vector<SubmapId> submaps;
  };

  ModelSubmap& Insert(std::shared_ptr<const RefinedSubmap> refined,
                      const std::optional<SubmapRelation>& link);
  void CollectSights(ModelSubmap* submap) const;
  void AttachLandmarks(SubmapId id);
  bool Conflict(const ModelLandmark& a, const ModelLandmark& b) const;
  void Unite(int into, int from);
  int NewLandmark();
  void SetComponent(SubmapId id, ComponentId component);
  Session& SessionOf(const RefinedSubmap& refined);

  MapModelOptions options_;
  std::map<SubmapId, ModelSubmap> submaps_;
  std::map<ComponentId, std::set<SubmapId>> members_;
  std::map<std::pair<AgentId, SessionId>, Session> sessions_;
  std::vector<ModelLandmark> landmarks_;
  std::vector<int> free_landmarks_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_MAP_MODEL_H_
