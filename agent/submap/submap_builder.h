// Gathers what one submap holds while it is open.
#ifndef PORTOLAN_AGENT_SUBMAP_SUBMAP_BUILDER_H_
#define PORTOLAN_AGENT_SUBMAP_SUBMAP_BUILDER_H_

#include <unordered_set>
#include <vector>

#include "agent/filter/local_filter.h"
#include "agent/tracker/tracker.h"
#include "common/base/status.h"
#include "common/submap/submap.h"

namespace portolan {

struct SubmapBuilderOptions {
  // Keyframes that fill a submap: bounds the filter's linearisation error and the message.
  int max_keyframes = 16;
  // Travelled distance that fills a submap, in median scene depths.
  double max_distance_depths = 1.0;
  // Accumulated rotation that fills a submap [rad].
  double max_rotation_rad = 1.5;
  // A submap that ends in a failure with fewer keyframes than this is not worth an upload.
  int min_keyframes = 3;
  // Keyframes 2, 2 + n, 2 + 2 n, ... are described for place recognition. (Keyframe 0 is the
  // predecessor's last one, which lies close to a described one already.)
  int keyframes_per_description = 8;
  // A landmark is uploaded with an estimate when its inverse depth is this many sigmas from zero.
  double min_inverse_depth_sigmas = 4.0;
  // Of more tracks those go that fewest keyframes see: the live poses use them all, the uplink
  // carries the best.
  int max_observations_per_keyframe = 240;

  Status Validate() const;
};

// Protocol: Open, then AddFrame for every frame and AddKeyframe for the chosen ones, then Close.
// Thread-compatible.
class SubmapBuilder {
 public:
  explicit SubmapBuilder(const SubmapBuilderOptions& options) : options_(options) {}

  // Starts an empty submap; what was gathered before is dropped.
  void Open(const SubmapKey& key, LinkType link);

  void AddFrame(Timestamp time, const Rigid3& submap_from_camera);

  // points: all live tracks. features: empty unless NextIsDescribed().
  void AddKeyframe(Timestamp time, const Rigid3& submap_from_camera, const Matrix6d& covariance,
                   const std::vector<TrackedPoint>& points, std::vector<Feature> features);

  // The keyframe to be added next is to be described.
  bool NextIsDescribed() const;

  // The submap has reached one of its limits. median_depth: of the scene, submap units.
  bool IsFull(double median_depth) const;

  // The unit of length has changed: one old unit is `scale` new ones.
  void Rescale(double scale);

  // Poses of some of its frames have become known better: they and all frames and keyframes up to
  // the last of them are moved. Ascending.
  void Restate(const std::vector<FramePose>& poses);

  // Ends the submap with the landmarks of the filter that its keyframes observed.
  Submap Close(const std::vector<LandmarkEstimate>& landmarks);

  // Ends the submap as it was at `time`: everything later is dropped, and with it the landmark
  // estimates, which already contain the failure.
  Submap CloseBefore(Timestamp time);

  const Submap& open() const { return submap_; }

 private:
  // Keeps the best tracks, and what they saw of landmarks; notes what links this submap to the
  // next.
  Submap Thinned(const std::vector<LandmarkEstimate>& landmarks);

  SubmapBuilderOptions options_;
  Submap submap_;
  // Tracks of the last submap's last keyframe: what links it to this one.
  std::unordered_set<TrackId> carried_;
  double distance_ = 0;
  double rotation_rad_ = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_SUBMAP_SUBMAP_BUILDER_H_
