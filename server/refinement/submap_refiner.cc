#include "server/refinement/submap_refiner.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "server/refinement/backward_start.h"
#include "server/refinement/bundle_covariance.h"

namespace portolan {
namespace {

// The posterior variance factor is trusted between these: pixel sigmas are at most wrong by a
// factor of two.
constexpr double kMinVarianceFactor = 0.25;
constexpr double kMaxVarianceFactor = 4.0;
// Keeps every landmark covariance positive definite in spite of rounding, relative to the depth.
constexpr double kRelativeVarianceFloor = 1e-10;

// The trial of the depth-reversed start ends after three iterations if it still costs this many
// times as much; it then takes a tenth of the refinement's time instead of a third.
constexpr double kHopelessCost = 4.0;
// ... and of a submap that costs no more than this an observation, first of all it has so many of
// the tracks, if there are twice as many: whether it is better shows in a part. Trials of all
// submaps so cost 1 mm of 7 on 7-Scenes redkitchen.
constexpr double kSoundCost = 1.6;
constexpr size_t kTrialTracks = 60;

struct Sight {
  int keyframe = 0;
  const Observation* observation = nullptr;
};
using SightsOfTrack = std::map<TrackId, std::vector<Sight>>;

SightsOfTrack CollectTracks(const Submap& submap) {
  SightsOfTrack tracks;
  for (size_t k = 0; k < submap.keyframes.size(); ++k) {
    for (const Observation& observation : submap.keyframes[k].observations) {
      tracks[observation.track].push_back({static_cast<int>(k), &observation});
    }
  }
  std::erase_if(tracks, [](const auto& track) { return track.second.size() < 2; });
  return tracks;
}

// Median distance of the filter's landmarks from the submap's origin; 1 without any.
double FilterSceneDepth(const Submap& submap) {
  std::vector<double> depths;
  for (const SubmapLandmark& landmark : submap.landmarks) {
    depths.push_back(landmark.point_in_submap.norm());
  }
  if (depths.empty()) return 1.0;
  std::nth_element(depths.begin(), depths.begin() + depths.size() / 2, depths.end());
  return std::max(depths[depths.size() / 2], 1e-9);
}

class Refinement {
 public:
  Refinement(const SubmapRefinerOptions& options, RefinedSubmap* submap)
      : options_(options), submap_(*submap), tracks_(CollectTracks(*submap->raw)) {}

  // Returns the quarantine reason, empty if there is none.
  std::string Run() {
    if (submap_.raw->keyframes.size() < 2) return "fewer than two keyframes";
    AddCameras();
    Triangulate();
    if (LandmarkCount() < options_.min_landmarks) return "too few tracks could be triangulated";
    std::string reason = AdjustInRounds();
    if (options_.try_other_starts) TryOtherStarts(&reason);
    if (!reason.empty()) return reason;
    return WriteResult();
  }

 private:
  // A filter's estimate can be so far off that few observations fit at first; the adjusted poses
  // make more of the tracks fit, these better poses, and so on.
  std::string AdjustInRounds() {
    std::string reason;
    for (int round = 0; round < options_.max_rounds; ++round) {
      reason = Adjust(options_.bundle);
      if (round > 0 && reason.empty()) break;
      if (!summary_.usable) break;
      const bool has_more = TriangulateMissing();
      if (reason.empty() && !has_more) break;
    }
    return reason;
  }

  using Start = bool (Refinement::*)();

  // As it stands, with some of the tracks.
  Refinement(const Refinement& whole, size_t track_count)
      : options_(whole.options_),
        submap_(whole.submap_),
        scene_depth_(whole.scene_depth_),
        filter_is_wrong_(whole.filter_is_wrong_) {
    problem_.cameras = whole.problem_.cameras;
    const size_t all = whole.tracks_.size();
    size_t point = 0;
    size_t begin = 0;
    for (const auto& [track, sights] : whole.tracks_) {
      // So many of all, evenly.
      const bool is_taken = (point + 1) * track_count / all > point * track_count / all;
      if (is_taken) {
        tracks_.emplace_hint(tracks_.end(), track, sights);
        const int own = static_cast<int>(problem_.points.size());
        problem_.points.push_back(whole.problem_.points[point]);
        for (size_t i = begin; i < begin + sights.size(); ++i) {
          problem_.observations.push_back(whole.problem_.observations[i]);
          problem_.observations.back().point = own;
        }
      }
      ++point;
      begin += sights.size();
    }
  }

  void TryOtherStarts(std::string* reason) {
    TryOther(reason, &Refinement::StartReversed);
    if (submap_.raw->link != LinkType::kConnected || !reason->empty() ||
        CostOfOne() > options_.suspicious_cost) {
      TryOther(reason, &Refinement::StartFromTheEnd);
    }
  }

  // Adjusts from another start as well, if there is one, and keeps what explains the observations
  // better.
  void TryOther(std::string* reason, Start start) {
    const bool is_sound = reason->empty() && CostOfOne() < kSoundCost;
    if (is_sound && tracks_.size() >= 2 * kTrialTracks && !IsBetterForSome(start)) return;
    const double cost = TruncatedCost();
    const BundleProblem problem = problem_;
    const BundleSummary summary = summary_;
    const bool filter_is_wrong = filter_is_wrong_;
    if (IsPromising(start)) {
      TriangulateMissing();
      const std::string other_reason = AdjustInRounds();
      if (summary_.usable && TruncatedCost() < options_.other_cost * cost) {
        *reason = other_reason;
        return;
      }
    }
    problem_ = problem;
    summary_ = summary;
    filter_is_wrong_ = filter_is_wrong;
  }

  // A sound submap comes to where it was from most starts; that, too, a part of the tracks tells.
  bool IsBetterForSome(Start start) const {
    Refinement here(*this, kTrialTracks);
    Refinement other = here;
    if (!other.IsPromising(start)) return false;
    other.TriangulateMissing();
    other.AdjustInRounds();
    here.AdjustInRounds();
    return other.summary_.usable &&
           other.TruncatedCost() < options_.other_cost * here.TruncatedCost();
  }

  // Starts there; a few iterations must come near the cost there is.
  bool IsPromising(Start start) {
    const double cost = TruncatedCost();
    if (!(this->*start)()) return false;
    BundleOptions quick = options_.bundle;
    quick.rounds = 1;
    quick.max_iterations = 3;
    Adjust(quick);
    if (!summary_.usable || !(TruncatedCost() < kHopelessCost * cost)) return false;
    quick.max_iterations = 7;
    Adjust(quick);
    return summary_.usable && TruncatedCost() < options_.other_trial_cost * cost;
  }

  // For small motions across the line of sight, inverse depths rho about their median m and the
  // motion (t, rotation w) give nearly the same flow as 2 m - rho and (-t, w + 2 m (-t_y, t_x, 0)):
  // the two-fold ambiguity of structure from motion under weak perspective (e.g. Szeliski & Kang,
  // "Shape ambiguities in structure from motion", PAMI 1997). A filter that starts without a prior
  // may settle in the wrong one, and descent does not leave it.
  bool StartReversed() {
    const double inverse_depth = 1.0 / MedianDepth(problem_);
    std::vector<Rigid3> poses;
    for (const BundleCamera& camera : problem_.cameras) {
      Rigid3 pose = camera.world_from_camera;
      Eigen::Vector3d& t = pose.translation;
      const Eigen::Vector3d turn = 2 * inverse_depth * Eigen::Vector3d(-t.y(), t.x(), 0);
      pose.rotation = (RotationExp(turn) * pose.rotation).normalized();
      t.head<2>() = -t.head<2>();
      poses.push_back(pose);
    }
    StartFrom(poses);
    return true;
  }

  // See backward_start.h.
  bool StartFromTheEnd() {
    BundleProblem filter = problem_;
    for (size_t k = 0; k < filter.cameras.size(); ++k) {
      filter.cameras[k].world_from_camera = submap_.raw->keyframes[k].submap_from_camera;
    }
    std::vector<std::optional<Eigen::Vector3d>> known;
    for (const auto& [track, sights] : tracks_) known.push_back(FilterPoint(track));
    const auto poses =
        StartBackward(filter, known, options_.bundle, options_.triangulation, scene_depth_);
    if (poses) StartFrom(*poses);
    return poses.has_value();
  }

  // The free cameras' poses; all points are triangulated anew, without the filter's.
  void StartFrom(const std::vector<Rigid3>& poses) {
    for (size_t k = 0; k < poses.size(); ++k) {
      BundleCamera& camera = problem_.cameras[k];
      if (camera.fixed) continue;
      camera.world_from_camera = poses[k];
      camera.prior =
          PositionPrior{poses[k].translation, options_.position_prior_max_of_depth * scene_depth_};
    }
    for (BundleObservation& observation : problem_.observations) observation.inlier = false;
    filter_is_wrong_ = true;
    TriangulateMissing();
  }

  // Sum of the squared errors in sigmas, none more than the outlier limit.
  double TruncatedCost() const {
    double cost = 0;
    for (const BundleObservation& observation : problem_.observations) {
      const double chi2 = ReprojectionChi2(problem_, observation);
      cost += chi2 < options_.bundle.outlier_chi2 ? chi2 : options_.bundle.outlier_chi2;
    }
    return cost;
  }

  // ... of an observation.
  double CostOfOne() const {
    return TruncatedCost() / static_cast<double>(problem_.observations.size());
  }

  void AddCameras() {
    scene_depth_ = FilterSceneDepth(*submap_.raw);
    for (const Keyframe& keyframe : submap_.raw->keyframes) {
      BundleCamera camera;
      camera.world_from_camera = keyframe.submap_from_camera;
      camera.model = submap_.camera.get();
      problem_.cameras.push_back(camera);
    }
    problem_.cameras[0].fixed = true;
  }

  void Triangulate() {
    for (const auto& [track, sights] : tracks_) {
      const int point = static_cast<int>(problem_.points.size());
      problem_.points.emplace_back();
      for (const Sight& sight : sights) {
        BundleObservation observation;
        observation.camera = sight.keyframe;
        observation.point = point;
        observation.pixel = sight.observation->pixel.cast<double>();
        observation.sigma_px = sight.observation->sigma_px;
        observation.inlier = false;
        problem_.observations.push_back(observation);
      }
    }
    TriangulateMissing();
    // Without landmarks of the filter the scene's depth was only assumed until here.
    if (submap_.raw->landmarks.empty()) scene_depth_ = MedianDepth(problem_);
    AddPriors();
  }

  void AddPriors() {
    for (size_t k = 1; k < problem_.cameras.size(); ++k) {
      BundleCamera& camera = problem_.cameras[k];
      const double variance =
          submap_.raw->keyframes[k].covariance.topLeftCorner<3, 3>().trace() / 3;
      const double sigma =
          std::clamp(options_.position_prior_sigmas * std::sqrt(std::max(variance, 0.0)),
                     options_.position_prior_min_of_depth * scene_depth_,
                     options_.position_prior_max_of_depth * scene_depth_);
      camera.prior = PositionPrior{camera.world_from_camera.translation, sigma};
    }
  }

  // Triangulates the points with fewer than two inliers, all of them the first time. True if it
  // found some.
  bool TriangulateMissing() {
    bool has_found = false;
    size_t begin = 0;
    size_t point = 0;
    for (const auto& [track, sights] : tracks_) {
      const auto first = problem_.observations.begin() + begin;
      const auto last = first + sights.size();
      begin += sights.size();
      const auto inliers =
          std::count_if(first, last, [](const BundleObservation& o) { return o.inlier; });
      if (inliers < 2) {
        has_found = TriangulatePoint(track, first, last, &problem_.points[point]) || has_found;
      }
      ++point;
    }
    return has_found;
  }

  bool TriangulatePoint(TrackId track, std::vector<BundleObservation>::iterator first,
                        std::vector<BundleObservation>::iterator last, BundlePoint* point) {
    std::vector<TrackSight> sights;
    for (auto it = first; it != last; ++it) {
      const BundleCamera& camera = problem_.cameras[it->camera];
      sights.push_back({{camera.world_from_camera, camera.model}, it->pixel, it->sigma_px});
    }
    const std::optional<TriangulatedPoint> result =
        TriangulateTrack(options_.triangulation, sights,
                         filter_is_wrong_ ? std::nullopt : FilterPoint(track), scene_depth_);
    if (!result) return false;
    point->point_in_world = result->point_in_world;
    for (auto it = first; it != last; ++it) it->inlier = result->inliers[it - first];
    return true;
  }

  std::optional<Eigen::Vector3d> FilterPoint(TrackId track) const {
    const std::vector<SubmapLandmark>& landmarks = submap_.raw->landmarks;
    const auto it = std::lower_bound(
        landmarks.begin(), landmarks.end(), track,
        [](const SubmapLandmark& landmark, TrackId id) { return landmark.track < id; });
    if (it == landmarks.end() || it->track != track) return std::nullopt;
    return it->point_in_submap;
  }

  std::vector<int> InlierCounts() const {
    std::vector<int> counts(problem_.points.size(), 0);
    for (const BundleObservation& observation : problem_.observations) {
      counts[observation.point] += observation.inlier ? 1 : 0;
    }
    return counts;
  }

  int LandmarkCount() const {
    const std::vector<int> counts = InlierCounts();
    return static_cast<int>(
        std::count_if(counts.begin(), counts.end(), [](int count) { return count >= 2; }));
  }

  std::string Adjust(const BundleOptions& bundle) {
    summary_ = AdjustBundle(bundle, nullptr, &problem_);
    if (!summary_.usable) return "the adjustment failed";
    const double share = static_cast<double>(summary_.inlier_count) /
                         static_cast<double>(problem_.observations.size());
    if (share < options_.min_inlier_share) return "too many observations disagree";
    if (LandmarkCount() < options_.min_landmarks) return "too few landmarks remain";
    std::vector<int> counts(problem_.cameras.size(), 0);
    for (const BundleObservation& observation : problem_.observations) {
      counts[observation.camera] += observation.inlier ? 1 : 0;
    }
    if (*std::min_element(counts.begin(), counts.end()) < options_.min_keyframe_inliers) {
      return "a keyframe has too few inliers";
    }
    return "";
  }

  std::string WriteResult() {
    const std::optional<BundleCovariance> covariance = BundleCovariance::Compute(problem_);
    if (!covariance) return "the adjusted system is singular";
    const double factor = VarianceFactor();
    for (size_t k = 0; k < problem_.cameras.size(); ++k) {
      submap_.submap_from_camera[k] = problem_.cameras[k].world_from_camera;
    }
    submap_.last_keyframe_covariance =
        factor * covariance->Camera(static_cast<int>(problem_.cameras.size()) - 1);
    submap_.rms_reprojection_px = summary_.rms_px;
    WriteLandmarks(*covariance, factor);
    return "";
  }

  void WriteLandmarks(const BundleCovariance& covariance, double factor) {
    const std::vector<int> counts = InlierCounts();
    int point = -1;
    for (const auto& [track, sights] : tracks_) {
      ++point;
      if (counts[point] < 2) continue;
      RefinedLandmark landmark;
      landmark.track = track;
      landmark.point_in_submap = problem_.points[point].point_in_world;
      const double floor = kRelativeVarianceFloor * landmark.point_in_submap.squaredNorm();
      const Eigen::Matrix3d spread =
          factor * covariance.Point(point) + floor * Eigen::Matrix3d::Identity();
      landmark.covariance = spread;
      landmark.observation_count = counts[point];
      if (spread.allFinite()) submap_.landmarks.push_back(landmark);
    }
    submap_.landmarks.shrink_to_fit();
  }

  // Residual variance over its expectation: the sigmas of the observations are the agent's guess.
  double VarianceFactor() const {
    const double unknowns =
        6.0 * static_cast<double>(problem_.cameras.size() - 1) + 3.0 * LandmarkCount();
    const double redundancy = std::max(2.0 * summary_.inlier_count - unknowns, 1.0);
    const double sum = summary_.rms_sigmas * summary_.rms_sigmas * summary_.inlier_count;
    return std::clamp(sum / redundancy, kMinVarianceFactor, kMaxVarianceFactor);
  }

  const SubmapRefinerOptions& options_;
  RefinedSubmap& submap_;
  SightsOfTrack tracks_;
  BundleProblem problem_;  // points parallel to tracks_, observations in the tracks' order
  BundleSummary summary_;
  double scene_depth_ = 1.0;
  bool filter_is_wrong_ = false;  // its points are no starts
};

}  // namespace

Status SubmapRefinerOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(triangulation.Validate());
  PORTOLAN_RETURN_IF_ERROR(bundle.Validate());
  if (!(position_prior_sigmas > 0) || !(position_prior_min_of_depth > 0) ||
      !(position_prior_max_of_depth >= position_prior_min_of_depth) || min_landmarks < 3 ||
      min_keyframe_inliers < 3 || !(min_inlier_share >= 0 && min_inlier_share <= 1)) {
    return absl::InvalidArgumentError("refinement: limits out of range");
  }
  return absl::OkStatus();
}

StatusOr<SubmapRefiner> SubmapRefiner::Create(const SubmapRefinerOptions& options) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  return SubmapRefiner(options);
}

std::shared_ptr<const RefinedSubmap> SubmapRefiner::Refine(
    SubmapId id, std::shared_ptr<const Submap> submap,
    std::shared_ptr<const CameraModel> camera) const {
  auto refined = std::make_shared<RefinedSubmap>();
  refined->id = id;
  refined->raw = std::move(submap);
  refined->camera = std::move(camera);
  for (const Keyframe& keyframe : refined->raw->keyframes) {
    refined->submap_from_camera.push_back(keyframe.submap_from_camera);
  }
  refined->quarantine_reason = Refinement(options_, refined.get()).Run();
  return refined;
}

}  // namespace portolan
