// Follows image points through a sequence, without drift and to sub-pixel accuracy.
#ifndef PORTOLAN_AGENT_TRACKER_TRACKER_H_
#define PORTOLAN_AGENT_TRACKER_TRACKER_H_

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <span>
#include <vector>

#include "agent/tracker/corner_detector.h"
#include "common/base/status.h"
#include "common/base/strong_id.h"
#include "common/camera/camera_model.h"
#include "common/features/feature_extractor.h"
#include "common/submap/submap.h"

namespace portolan {

// Where the filter expects a track in the next image, raw (distorted) pixels.
struct TrackPrediction {
  TrackId track;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  // Of the pixel; what kActiveSearch looks in is its 3-sigma ellipse.
  Eigen::Matrix2d covariance_px2 = 25.0 * Eigen::Matrix2d::Identity();
};

// How a live track is found in the next image. Either way the alignment with its reference patch
// gives the pixel and decides whether it is the same point.
enum class MatcherType {
  kPyramidalFlow,  // Lucas-Kanade from the previous image (patch_flow.h)
  kActiveSearch,   // correlation over the predicted ellipse (patch_search.h)
};

// A live track in the current image.
struct TrackedPoint {
  TrackId track;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // raw (distorted)
  double sigma_px = 1.0;                            // standard deviation per axis
  int age_frames = 0;                               // images since it was detected
};

// The point of a track among points by ascending track; null if there is none.
const TrackedPoint* FindPoint(const std::vector<TrackedPoint>& points, TrackId track);

// Where a lost track is looked for: the 3-sigma ellipse of the covariance about the pixel.
struct SearchRegion {
  TrackId track;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  Eigen::Matrix2d covariance_px2 = Eigen::Matrix2d::Identity();
  // How the image about the point has changed, there = pixel + warp * (then - then's pixel), since
  // about when it was lost.
  Eigen::Matrix2d warp = Eigen::Matrix2d::Identity();
};

struct TrackerOptions {
  // Live tracks at most; the filter uses a part, the uplink the longest, the live poses all.
  int max_points = 300;
  // Fewer where they would be nearer to each other than this in the mean: in a small image more
  // tracks are worse ones.
  double min_spacing_px = 19.0;
  // Least distance of a new corner from the other tracks, as a share of their distance when
  // max_points are spread evenly.
  double min_distance_share = 0.3;
  // No track nearer to the image's edge than this: half a patch and its warp must fit.
  double border_px = 10.0;
  // Two tracks nearer than this are one: the younger goes.
  double merge_distance_px = 3.0;
  // Flow needs no covariance and bridges what a wrong prediction leaves.
  MatcherType matcher = MatcherType::kPyramidalFlow;
  // kActiveSearch: standard deviation of where a track without prediction will be, px; the first
  // frames and the auxiliary tracks are looked for this far (times three) from the turned pixel.
  double search_sigma_px = 5.0;
  // Least zero-mean normalised cross-correlation with the reference patch to live on.
  double min_correlation = 0.75;
  // Least correlation to revive a lost track: stricter, as the whole search region competes.
  double min_reacquire_correlation = 0.85;
  // Pyramid levels above the image itself for the search from frame to frame; capped so that the
  // smallest level keeps 40 px.
  int pyramid_levels = 3;
  // What TrackOthers finds farther than this from its prediction, and than three sigmas, is another
  // point. Far more than a young filter's error: were tracks lost that contradict it, those left
  // would be the ones that share its error, and the submaps with them.
  double gate_px = 8.0;
  // Standard deviation of a perfect match.
  double base_sigma_px = 0.5;
  // Patches of lost tracks kept for re-acquisition.
  int max_lost = 800;
  DetectorOptions detector;
  FeatureExtractorOptions features;

  Status Validate() const;
};

// Protocol per image: Track, or TrackPredicted and TrackOthers, then any of Drop, Reacquire,
// Detect, Describe, which all refer to that image. The same images and calls give the same tracks.
// Owns copies of what it needs of an image. Thread-compatible.
class Tracker {
 public:
  static StatusOr<std::unique_ptr<Tracker>> Create(const TrackerOptions& options,
                                                   const CameraModel& camera);
  ~Tracker();
  Tracker(const Tracker&) = delete;
  Tracker& operator=(const Tracker&) = delete;

  // Moves all live tracks into the image; those that cannot be found are lost. gray: CV_8UC1 of
  // the camera's size, else InvalidArgument and nothing changes. Predictions of unknown tracks are
  // ignored. previous_from_current is the camera's rotation since the previous image, the start
  // for tracks without prediction; identity if unknown.
  Status Track(const cv::Mat& gray, std::span<const TrackPrediction> predictions,
               const Eigen::Quaterniond& previous_from_current);

  // The same in two steps, so that what the first tracks tell of the camera's motion helps to find
  // the others: at first those with a prediction, ...
  Status TrackPredicted(const cv::Mat& gray, std::span<const TrackPrediction> predictions,
                        const Eigen::Quaterniond& previous_from_current);
  // ... then the rest. Here what has a prediction is looked for there alone, and lost if what is
  // found is another point (gate_px). Where that happens to many, those without prediction are lost
  // as well.
  void TrackOthers(std::span<const TrackPrediction> predictions,
                   const Eigen::Quaterniond& previous_from_current);

  // Starts tracks at the best corners of empty grid cells, up to max_points. Returns the new ones,
  // ascending.
  std::vector<TrackId> Detect();

  // Starts a track at a pixel, corner or not, beyond max_points too. No value where the image has
  // too little texture or ends.
  std::optional<TrackId> StartAt(const Eigen::Vector2d& pixel);

  // Ends tracks, for good; ids that are not live are ignored.
  void Drop(std::span<const TrackId> tracks);

  // Looks for lost tracks by correlation of their stored patch; found ones live on under the same
  // id. Returns them, ascending. Unknown and live tracks are ignored.
  std::vector<TrackId> Reacquire(std::span<const SearchRegion> lost);

  // Tracks that Reacquire can bring back, ascending.
  std::vector<TrackId> lost() const;

  // Live tracks that Detect fills up to.
  int max_points() const;

  // Live tracks that are in the current image, ascending id.
  const std::vector<TrackedPoint>& points() const;

  // Descriptors of all live tracks and of further corners of the current image, as the server gets
  // them; or, which is cheaper, of the tracks alone and at full size only.
  std::vector<Feature> Describe(bool complete = true) const;

 private:
  class Impl;
  explicit Tracker(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_TRACKER_TRACKER_H_
