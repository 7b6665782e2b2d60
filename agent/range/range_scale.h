// Laser ranges as measurements of a local filter: they find the metres of a monocular map, and
// hold them.
#ifndef PORTOLAN_AGENT_RANGE_RANGE_SCALE_H_
#define PORTOLAN_AGENT_RANGE_RANGE_SCALE_H_

#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "agent/filter/local_filter.h"
#include "agent/image_source/samples.h"
#include "agent/landmarks/landmark_initializer.h"
#include "agent/range/range_buffer.h"
#include "agent/range/scale_finder.h"
#include "agent/tracker/tracker.h"
#include "common/base/status.h"
#include "common/camera/camera_model.h"

namespace portolan {

struct RangeOptions {
  ScaleFinderOptions scale;
  // A sample this much older than the image is none of the image [s].
  double max_age_s = 0.12;
  // The spots of the laser that are followed: most at a time, and least time between two [s].
  int max_spots = 20;
  double spot_interval_s = 0.05;
  // A spot's distance is known once it was seen from so far apart [rad] and with such a relative
  // error.
  double min_parallax_rad = 0.04;
  double max_depth_sigma_ratio = 0.06;
  // It is taken when its track ends, or as soon as it is known so well.
  double good_depth_sigma_ratio = 0.025;
  // Relative error of the distance by where exactly the laser met the surface: its beam's width,
  // the mounting, the time.
  double spot_sigma = 0.02;
  // The map's own, about the spot against the whole of it.
  double map_sigma = 0.01;
  // Drift of a map's scale: relative, grows with the root of the way in median scene depths.
  double scale_drift = 0.02;
  // A range outside of this chi-square(1) region (99 %) of its prediction changes nothing.
  double gate_chi2 = 6.63;
  // After so many outside of the gate in a row the scale is looked for anew.
  int max_rejected_in_row = 8;
  // After so long without a range inside of the gate lengths no longer count as metres [s].
  double trusted_gap_s = 10.0;

  Status Validate() const;
};

struct RangeCounts {
  int64_t followed = 0;   // spots that a track was started at
  int64_t lost = 0;       // of these, before their distance was known
  int64_t used = 0;       // counted for the scale
  int64_t rejected = 0;   // outside of the gate
  int64_t off_image = 0;  // the spot is not in the image
};

// The spot that the laser lit is followed as a track of the image. Once that has moved enough its
// distance is known in the filter's unit, by triangulation, and in metres, by the range: no surface
// has to be supposed between landmarks. README.md.
//
// Protocol: AddSamples as they come; after every update of the filter Use, then, if SpotToFollow
// gives a pixel, Follow with the track that was started there; Rebase when the filter has begun a
// submap, Reset when it starts anew. Thread-compatible.
class RangeScale {
 public:
  // InvalidArgument if the ray is never in the image.
  static StatusOr<RangeScale> Create(const RangeOptions& options, const RangeFinder& finder,
                                     const CameraModel& camera);

  void AddSamples(std::span<const RangeSample> samples) { samples_.Add(samples); }
  void Reset();

  // `points`: what this frame saw of all tracks, ascending id. A value if the filter's unit of
  // length has just become the metre: of which an old one held so many.
  std::optional<double> Use(const std::vector<TrackedPoint>& points, LocalFilter* filter);
  std::optional<Eigen::Vector2d> SpotToFollow() const;
  void Follow(TrackId track);
  // What the ranges since then have found the metre to be, in the filter's unit, which becomes it;
  // for the end of a submap, which so has one scale, that of all its ranges. 1 if there is nothing
  // to correct.
  double CorrectScale(LocalFilter* filter);
  // The submap's frame has become another one.
  void Rebase(const Rigid3& old_from_new);
  // Another sensor has told the unit of length.
  void Rescale(double scale);

  const RangeSampleCounts& sample_counts() const { return samples_.counts(); }
  const RangeCounts& counts() const { return counts_; }
  // Relative error of the scale, once there is one.
  double scale_sigma() const { return std::sqrt(log_scale_variance_); }

 private:
  // A range, and where it was measured.
  struct Spot {
    TrackId track;
    Timestamp time{};
    double distance_m = 0;  // from the camera
    double sigma_m = 0;
    Eigen::Vector3d camera_in_submap;
    Eigen::Vector2d pixel;  // in the image after it
    // The best so far.
    std::optional<ScaleFinder::Ratio> ratio;
    double depth_sigma_ratio = 0;
  };

  RangeScale(const RangeOptions& options, const RangeFinder& finder, const CameraModel& camera);

  void FindSpot(const LocalFilter& filter);
  void Measure(const LocalFilter& filter, Spot* spot) const;
  std::optional<double> TakeRatio(const ScaleFinder::Ratio& ratio, LocalFilter* filter);
  // False if the ratio is outside of the gate.
  bool UpdateScale(const ScaleFinder::Ratio& ratio);
  bool UpdateFilter(const ScaleFinder::Ratio& ratio, LocalFilter* filter) const;
  std::optional<double> TakeScale(LocalFilter* filter);
  void Drift(LocalFilter* filter);
  void ScaleLengths(double scale);

  const RangeOptions options_;
  const RangeFinder finder_;
  const CameraModel camera_;
  RangeBuffer samples_;
  LandmarkInitializer depths_;  // of the spots
  std::vector<Spot> spots_;
  std::optional<Spot> new_spot_;
  std::optional<Timestamp> last_followed_;
  ScaleFinder scale_;
  std::optional<Timestamp> last_inside_;
  int rejected_in_row_ = 0;
  // Logarithm of metres over the filter's unit, and its variance.
  double log_scale_ = 0;
  double log_scale_variance_ = 0;
  std::optional<Timestamp> last_frame_;
  RangeCounts counts_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_RANGE_RANGE_SCALE_H_
