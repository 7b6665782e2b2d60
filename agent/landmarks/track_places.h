// Where tracks must be in the image: live ones, and lost ones once the camera looks there again.
#ifndef PORTOLAN_AGENT_LANDMARKS_TRACK_PLACES_H_
#define PORTOLAN_AGENT_LANDMARKS_TRACK_PLACES_H_

#include <Eigen/Core>
#include <map>
#include <optional>
#include <vector>

#include "agent/tracker/tracker.h"
#include "common/base/status.h"
#include "common/camera/camera_model.h"
#include "common/geometry/rigid3.h"

namespace portolan {

struct TrackPlacesOptions {
  bool enabled = true;
  // Tracks that are remembered, live ones too; those that were not seen for longest go.
  int max_tracks = 800;
  // Keyframes that must have seen a track, and root of the sum of squared angles of its rays about
  // their mean direction [rad]: otherwise its distance is not known.
  int min_views = 3;
  double min_parallax_rad = 0.05;
  // Error of a ray, that of its camera pose included, and how far the prediction is off for other
  // reasons than the point's own uncertainty. What is predicted less well is neither bound nor
  // looked for.
  double pixel_sigma_px = 1.0;
  double drift_sigma_px = 0.8;
  double max_sigma_px = 2.0;
  // Seen from a direction that differs by more, or from a distance by this factor, it looks
  // otherwise.
  double max_view_angle_rad = 0.5;
  double max_distance_factor = 1.6;
  // Tracks that are looked for in a keyframe.
  int max_searched = 100;

  Status Validate() const;
};

// Remembers of every track the point nearest to its rays (linear triangulation with the filter's
// poses; Hartley & Sturm, CVIU 1997, "mid-point"), kept as sums that cost nothing to extend:
// sum of (I - b b') p = sum of (I - b b') o over rays from o along b. Thread-compatible.
class TrackPlaces {
 public:
  TrackPlaces(const TrackPlacesOptions& options, const CameraModel& camera)
      : options_(options), camera_(camera) {}

  void Reset() { tracks_.clear(); }
  // The submap's frame, or its unit of length, becomes another one.
  void Rebase(const Rigid3& old_from_new);
  void Rescale(double scale);
  // Books a keyframe. Returns the tracks whose rays miss each other: they have slipped from one
  // point to another, unseen.
  std::vector<TrackId> AddKeyframe(const Rigid3& submap_from_camera,
                                   const std::vector<TrackedPoint>& points);

  // Where the camera should see the tracks of the keyframe booked last whose place is known.
  std::vector<TrackPrediction> PredictLive(const Rigid3& submap_from_camera) const;

  // Where the present camera should see those of the lost tracks (ascending) whose place is known;
  // the ones seen last come first. The regions' warp is that since the last keyframe that saw them.
  std::vector<SearchRegion> ExpectLost(const Rigid3& submap_from_camera,
                                       const std::vector<TrackId>& lost) const;

 private:
  struct Point {
    Eigen::Vector3d position;
    Eigen::Matrix3d covariance;
  };
  struct Track {
    Eigen::Matrix3d projectors = Eigen::Matrix3d::Zero();  // sum of I - b b'
    Eigen::Vector3d moments = Eigen::Vector3d::Zero();     // sum of (I - b b') o
    double squares = 0;                                    // sum of o' (I - b b') o
    int views = 0;
    int seen_at = 0;  // number of the keyframe
    Rigid3 seen_from;
    // From all of that, if it tells.
    std::optional<Point> point = std::nullopt;
  };

  // With drift_sigma_px in the covariance; no value if it is not in front of the camera, or not
  // known to max_sigma_px.
  struct Prediction {
    Eigen::Vector2d pixel;
    Eigen::Matrix2d covariance_px2;
    Matrix23d d_pixel_d_point_in_camera;
  };

  std::optional<Prediction> Predict(const Point& point, const Rigid3& camera_from_submap) const;
  // No point without parallax, and if the rays miss it.
  std::optional<Point> Triangulate(const Track& track, bool* misses) const;
  // Of a track whose place is known; its id is the caller's business.
  std::optional<SearchRegion> Expect(const Track& track, const Rigid3& submap_from_camera,
                                     const Rigid3& camera_from_submap) const;

  const TrackPlacesOptions options_;
  const CameraModel camera_;
  int keyframe_count_ = 0;
  std::map<TrackId, Track> tracks_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_LANDMARKS_TRACK_PLACES_H_
