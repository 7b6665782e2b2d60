// Delayed starts of landmarks: their depth is triangulated from the views that a track had before
// it became a landmark.
#ifndef PORTOLAN_AGENT_LANDMARKS_LANDMARK_INITIALIZER_H_
#define PORTOLAN_AGENT_LANDMARKS_LANDMARK_INITIALIZER_H_

#include <Eigen/Core>
#include <deque>
#include <optional>
#include <unordered_map>
#include <vector>

#include "agent/filter/measurement.h"
#include "agent/landmarks/triangulation.h"
#include "agent/tracker/tracker.h"
#include "common/base/status.h"
#include "common/camera/camera_model.h"

namespace portolan {

enum class InitializationMethod {
  // Undelayed: with the filter's prior, infinity included (Civera 2008).
  kInverseDepth,
  // From the first and the present view with the filter's poses, by DLT.
  kTwoView,
  // From all kept views with the filter's poses, by Levenberg-Marquardt.
  kMultiView,
  // Chen, Rodrigo, Samarabandu, ICIA 2006: kTwoView, then corrected in the same step by the
  // innovation against the position that two-view geometry alone (essential matrix, RANSAC) gives.
  kTwoViewUpdate,
};

struct LandmarkInitializerOptions {
  InitializationMethod method = InitializationMethod::kInverseDepth;
  // Least angle between the first ray and the present one. At 525 px a pixel is 0.0019 rad: an
  // inverse depth is then known to about 5 %.
  double min_parallax_rad = 0.04;
  // Largest sigma of a triangulated inverse depth over its value.
  double max_sigma_ratio = 0.3;
  // Every n-th frame is kept as a view, for all tracks the same ones, and at most so many: the
  // farther back, the more the filter's drift counts.
  int view_interval_frames = 3;
  int max_views = 20;
  // Error of a view, that of its camera pose included, as the filter's model_sigma_px.
  double pixel_sigma_px = 1.0;
  // With fewer landmarks measured, new ones start undelayed all the same: without any, or turning
  // on the spot, there is nothing to triangulate from. The classic minimum.
  int min_landmarks = 14;

  Status Validate() const;
};

// README.md has the derivations. A depth that is triangulated with the filter's own poses is as
// long or short as the filter's unit; LocalFilter::AddLandmarks adds that common error. The poses
// of the views are otherwise taken for known up to pixel_sigma_px. Does nothing, and costs nothing,
// with kInverseDepth. Thread-compatible.
class LandmarkInitializer {
 public:
  LandmarkInitializer(const LandmarkInitializerOptions& options, const CameraModel& camera);

  // Whether new landmarks have to wait, with so many measured in this frame.
  bool IsDelayed(int measured) const {
    return options_.method != InitializationMethod::kInverseDepth &&
           measured >= options_.min_landmarks;
  }

  void Reset();
  // The submap's frame, or its unit of length, becomes another one.
  void Rebase(const Rigid3& old_from_new);
  void Rescale(double scale);
  // Books the present frame and all its live points.
  void AddFrame(const Rigid3& submap_from_camera, const std::vector<TrackedPoint>& points);
  // Whether the track has the parallax now.
  bool IsReady(TrackId track) const;
  // Depths of the tracks in the present frame; those without one are removed from *tracks.
  std::vector<MeasuredDepth> Measure(std::vector<TrackId>* tracks) const;
  // Of a live track: where the present frame sees it, a unit vector in the camera.
  const Eigen::Vector3d& PresentBearing(TrackId track) const {
    return candidates_.at(track).bearing;
  }

 private:
  struct View {
    int frame = 0;
    Eigen::Vector3d bearing;
  };
  struct Candidate {
    std::deque<View> views;   // kept ones, oldest first; the present frame not among them
    Eigen::Vector3d bearing;  // in the present frame
    double sigma_rad = 0;     // of a bearing
    bool live = false;
  };
  struct Frame {
    int number = 0;
    Rigid3 submap_from_camera;
  };

  const Frame& FrameOf(int number) const;
  BearingView ViewFromPresent(const View& view) const;
  std::vector<BearingView> ViewsFromPresent(const Candidate& candidate) const;
  std::optional<DepthEstimate> Triangulate(const Candidate& candidate,
                                           const BearingView& view) const;
  std::optional<DepthEstimate> MultiView(const Candidate& candidate) const;
  // The two-view geometry of the present frame with an earlier one that many tracks share.
  struct Geometry {
    int frame = 0;
    Rigid3 then_from_now;
  };
  std::optional<Geometry> FindGeometry(const std::vector<TrackId>& tracks) const;
  int SharedFrame(const std::vector<TrackId>& tracks) const;
  std::optional<DepthEstimate> Corrected(const Candidate& candidate, const DepthEstimate& depth,
                                         const Geometry& geometry) const;

  const LandmarkInitializerOptions options_;
  const CameraModel camera_;
  int frame_count_ = 0;
  Rigid3 submap_from_camera_;  // present
  std::deque<Frame> frames_;   // kept, oldest first
  std::unordered_map<TrackId, Candidate> candidates_;
};

// Kalman update of one depth by another that is taken for independent.
DepthEstimate FuseDepths(const DepthEstimate& a, const DepthEstimate& b);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_LANDMARKS_LANDMARK_INITIALIZER_H_
