// Bundle adjustment over the agent's last keyframes: a better motion than the filter's, whose
// linearisation it does not share, and the link to what the server has adjusted.
#ifndef PORTOLAN_AGENT_LOCAL_ADJUSTMENT_LOCAL_ADJUSTMENT_H_
#define PORTOLAN_AGENT_LOCAL_ADJUSTMENT_LOCAL_ADJUSTMENT_H_

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "agent/local_adjustment/known_fit.h"
#include "common/bundle/bundle_options.h"
#include "common/bundle/resection.h"
#include "common/bundle/triangulation.h"
#include "common/camera/camera_model.h"
#include "common/geometry/similarity3.h"
#include "common/submap/submap.h"

namespace portolan {

struct LocalAdjustmentOptions {
  // Keyframes of an adjustment, and how many of them it moves; the older ones hold pose and scale.
  int max_keyframes = 24;
  int max_free_keyframes = 12;
  // Keyframes that are kept, so that the server's correction of a submap finds them: two submaps
  // and what is taken until a correction arrives.
  int max_kept_keyframes = 48;
  // After a correction of the server everything since its last held keyframe is adjusted once, up
  // to so many keyframes.
  int max_free_after_correction = 20;
  // Of the corrected keyframes so many last ones are not held, only begun from: when the server
  // placed them nothing had been seen after them, now it has. Half of them at least are held.
  int free_corrected = 7;
  BundleOptions bundle{.max_iterations = 4, .function_tolerance = 1e-3};
  // Iterations after a correction, and until the first max_keyframes are there: these starts are
  // farther from the solution.
  int max_start_iterations = 10;
  TriangulationOptions triangulation;
  ResectionOptions resection;
  // The lens and the shutter are looked for in every max_keyframes keyframes anew, so many times;
  // 0: never. How far the calibration's k1 and k2 may be off, at the image's corner.
  int max_lens_windows = 12;
  double lens_corner_sigma_px = 5.0;
  // How long it may take from the first row to the last one until an image is read: standard
  // deviation about none, either way up; 0: all rows are taken at once.
  double readout_sigma_s = 0.02;
  // A calibration with distortion is believed.
  bool trust_distortion = true;
  // Once it is known to this much it stays: every change costs, for the window was placed by the
  // lens before.
  double lens_known_px = 1.0;
  // The same of the readout.
  double readout_known_s = 5e-4;
  // By how much a window tells less of lens and shutter than white noise would let it.
  double lens_noise_factor = 2.0;
  KnownFitOptions known_fit;
  // With fewer triangulated points an adjustment has no say.
  int min_points = 20;

  Status Validate() const;
};

// What a frame saw of a track.
struct LiveSight {
  Observation observation;
  // A landmark of the filter that was no outlier: measured and found consistent, or new.
  bool trusted = false;
  // BundleObservation::row_motion.
  Eigen::Vector2f row_motion = Eigen::Vector2f::Zero();
};

// Poses are in the window's frame and unit: those of the odometry until Hold has put the window in
// the world. Of the odometry only motions between successive frames count, as predictions and for
// the unit of length at the start.
//
// Protocol: Start; then Locate for every tracked frame in order of time, after it AddKeyframe if
// the frame is a keyframe, and SetRowMotion until the next one; Restate before the Locate of the
// frame that brought it; Hold in between, whenever the server has told poses of keyframes.
//
// Landmarks of the map that keyframes see again are points that no adjustment moves. All of the
// window first follows them, as it has drifted as a whole, then its free keyframes one by one.
// Thread-compatible, deterministic.
class LocalAdjustment {
 public:
  struct KeyframePose {
    Timestamp time{};
    Rigid3 window_from_camera;
  };

  LocalAdjustment(const LocalAdjustmentOptions& options, const CameraModel& camera);

  // Forgets everything: a new piece of odometry begins.
  void Start();

  // The pose of a frame; of the first one the odometry's. sights: ascending track id.
  Rigid3 Locate(const Rigid3& odometry_from_camera, std::span<const LiveSight> sights);
  // The frame that was located last is a keyframe. known: landmarks of the map that it shows.
  void AddKeyframe(Timestamp time, std::vector<KnownSight> known = {});

  // The odometry has changed its mind about frames since Start: their poses now, ascending time.
  // last_located: time of the frame that was located last.
  void Restate(const Rigid3& odometry_from_submap, std::span<const FramePose> frames,
               Timestamp last_located);

  // A better row motion [px/s] of the last keyframe's sight of a track; ignored if it has none.
  void SetRowMotion(TrackId track, const Eigen::Vector2f& row_motion);

  // k1 and k2 of the lens as somebody who has seen more has found it, less the calibration's; the
  // window no longer looks for k1 and k2 by itself, but for the readout. Zero, or a lens that
  // cannot be, changes nothing.
  void SetLens(const Eigen::Vector2d& added_radial);

  // Known poses of keyframes, in ascending time and another frame, which becomes the window's. They
  // are held from now on, but for the last few, older keyframes forgotten, younger ones follow.
  // False, and nothing changes, if fewer than two of them are kept. position_of: where known
  // landmarks are by now.
  using PositionOf = std::function<std::optional<Eigen::Vector3d>(const KnownLandmarkId&)>;
  bool Hold(std::span<const KeyframePose> keyframes, const PositionOf& position_of = {});

  // Keyframes as they are believed to be now, ascending time.
  std::vector<KeyframePose> Keyframes() const;
  // The frame located last as it is believed to be now.
  const Rigid3& window_from_camera() const { return window_from_camera_; }
  // Window units per unit of the odometry.
  double scale() const { return scale_; }
  int point_count() const { return static_cast<int>(points_.size()); }
  // With the lens as it is believed to be now.
  const CameraModel& camera() const { return camera_; }
  // From the first row to the last one as it is believed to be now; negative if the last one is
  // first. None in the world: the map takes all rows for seen at once, and where keyframes are held
  // that were placed so, points and poses must be made of the same pixels.
  double readout_s() const { return in_world_ ? 0 : readout_s_; }

 private:
  struct WindowKeyframe {
    Timestamp time{};
    Rigid3 odometry_from_camera;
    Rigid3 window_from_camera;
    std::vector<LiveSight> sights;
    bool held = false;
    std::vector<KnownSight> known = {};
  };
  struct WindowPoint {
    TrackId track;
    Eigen::Vector3d point_in_window = Eigen::Vector3d::Zero();
    DepthPoint seen_from_last;
  };
  struct Sight {
    TrackId track;
    int keyframe = 0;
    const LiveSight* sight = nullptr;
  };

  void FitToPoints();
  const WindowPoint* FindPoint(TrackId track) const;
  void Adjust(int max_free, int max_iterations);
  // The problem of the keyframes from `first` on, those before `first_free` held; returns the
  // points' tracks, or none if they are too few.
  std::vector<TrackId> MakeProblem(int first, int first_free, BundleProblem* problem) const;
  // The last max_keyframes keyframes, all free, and the lens.
  void AdjustLens();
  BundleLens LensPrior() const;
  // Where all rows had been seen at the image's time; as it was seen in the world (see readout_s).
  Eigen::Vector2d PixelOf(const LiveSight& sight) const {
    return sight.observation.pixel.cast<double>() + readout_s() * sight.row_motion.cast<double>();
  }
  std::vector<Sight> CollectSights(int first, int first_free) const;
  void AddCameras(int first, int first_free, BundleProblem* problem) const;
  void AddPoint(std::span<const Sight> sights, int first, double scene_depth,
                BundleProblem* problem) const;
  void AddKnown(int first, int first_free, BundleProblem* problem) const;
  void Move(const Similarity3& new_from_old);
  // Moves all to where the known landmarks are.
  void FollowKnown();
  void TakeResult(const BundleProblem& problem, const std::vector<TrackId>& tracks, int first);
  void MeasureDepth(std::span<const BundleObservation> observations,
                    const std::vector<CameraState>& cameras, double prior_sigma,
                    WindowPoint* point) const;
  void MeasureScale();
  double SceneDepth() const;

  const LocalAdjustmentOptions options_;
  const CameraModel calibration_;
  // Its lens changes.
  CameraModel camera_;
  // Its square root information is what is known of lens and readout after the windows before.
  BundleLens lens_;
  bool lens_is_known_ = false;
  double readout_s_ = 0;
  bool readout_is_known_ = false;
  int lens_windows_ = 0;
  int keyframes_since_lens_ = 0;
  std::vector<WindowKeyframe> keyframes_;
  // Of the last adjustment's tracks, ascending.
  std::vector<WindowPoint> points_;
  double scale_ = 1;
  // Hold has put the window there.
  bool in_world_ = false;
  // How it has moved since then to follow known landmarks.
  Similarity3 followed_;
  // Of the frame located last.
  std::optional<Rigid3> odometry_from_camera_;
  Rigid3 window_from_camera_;
  // Without those that contradict it.
  std::vector<LiveSight> sights_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_LOCAL_ADJUSTMENT_LOCAL_ADJUSTMENT_H_
