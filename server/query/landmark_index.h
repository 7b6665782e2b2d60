// Finds fused landmarks in a region or near a point of one component's world.
#ifndef PORTOLAN_SERVER_QUERY_LANDMARK_INDEX_H_
#define PORTOLAN_SERVER_QUERY_LANDMARK_INDEX_H_

#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include "server/fusion/map_state.h"

namespace portolan {

struct LandmarkFilter {
  int min_observation_count = 0;
};

// Two levels: the bounding boxes of the submaps' landmarks, and in each submap its landmarks'
// positions, packed. Both are scanned: 10,000 boxes take 20 us, and most regions touch few
// submaps. As submaps are immutable, a new version of the map indexes only those that changed.
// Immutable, thread-safe.
class LandmarkIndex {
 public:
  // `previous` may be null; what is unchanged since is shared with it.
  static std::shared_ptr<const LandmarkIndex> Build(std::shared_ptr<const MapSnapshot> snapshot,
                                                    const LandmarkIndex* previous);

  const MapSnapshot& snapshot() const { return *snapshot_; }
  // Of the component with the most landmarks, the oldest of them; 0 in an empty map.
  ComponentId LargestComponent() const;

  // The results point into the snapshot, which the index keeps. Ascending id.
  std::vector<const FusedLandmark*> InBox(ComponentId component, const Eigen::Vector3d& min,
                                          const Eigen::Vector3d& max,
                                          const LandmarkFilter& filter = {}) const;
  // Nearest first; equally near ones by id.
  std::vector<const FusedLandmark*> InSphere(ComponentId component, const Eigen::Vector3d& center,
                                             double radius,
                                             const LandmarkFilter& filter = {}) const;
  std::vector<const FusedLandmark*> Nearest(ComponentId component, const Eigen::Vector3d& point,
                                            size_t count, const LandmarkFilter& filter = {}) const;

 private:
  // The landmarks of one submap.
  struct Block {
    std::shared_ptr<const SubmapState> state;
    ComponentId component;
    Eigen::AlignedBox3d bounds;
    // Parallel to state->landmarks. Rounded to float for the scan; what passes it with a margin
    // for the rounding is decided by the exact position.
    std::vector<Eigen::Vector3f> points;
    float rounding = 0;  // no coordinate is off by more
  };

  // The bounds side by side, as every query looks at all of them.
  struct BoundedBlock {
    Eigen::AlignedBox3d bounds;
    const Block* block = nullptr;
  };
  struct ComponentBlocks {
    std::vector<BoundedBlock> blocks;
    size_t landmark_count = 0;
  };

  static std::shared_ptr<const Block> MakeBlock(std::shared_ptr<const SubmapState> state);
  const std::vector<BoundedBlock>& BlocksOf(ComponentId component) const;

  std::shared_ptr<const MapSnapshot> snapshot_;
  std::map<ComponentId, ComponentBlocks> components_;
  // Parallel to the snapshot's submaps; null for those without landmarks.
  std::vector<std::shared_ptr<const Block>> blocks_;
};

// The index of the newest version, made when it is asked for. Thread-safe.
class LandmarkIndexCache {
 public:
  std::shared_ptr<const LandmarkIndex> Get(std::shared_ptr<const MapSnapshot> snapshot);

 private:
  std::mutex mutex_;
  std::shared_ptr<const LandmarkIndex> index_;  // guarded by mutex_
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_QUERY_LANDMARK_INDEX_H_
