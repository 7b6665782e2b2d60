#include "server/alignment/window_problem.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <span>

#include "server/alignment/unit_keeping.h"

namespace portolan {
namespace {

// Any value serves: nothing else knows the scale then.
constexpr double kScaleGaugeSigma = 1e-3;

}  // namespace

WindowProblem::WindowProblem(const MapAdjusterOptions& options, const std::vector<SubmapId>& window,
                             MapModel* model, const PositionReferences* positions)
    : options_(options),
      window_(window.begin(), window.end()),
      model_(*model),
      positions_(positions) {
  AddLandmarks();
  if (positions_ != nullptr) {
    AddMetricDistances();
    AddFixes();
    for (const SurveyedPoint& point : positions_->points) AddSurveyedPoint(point);
  } else {
    FixGauge();
  }
  AddLenses();
}

MapAdjustment WindowProblem::contents() const {
  MapAdjustment contents;
  for (const BundleCamera& camera : problem_.cameras) contents.cameras += camera.fixed ? 0 : 1;
  contents.landmarks = static_cast<int>(point_landmarks_.size());
  contents.observations = static_cast<int>(names_.size());
  return contents;
}

void WindowProblem::AddLandmarks() {
  std::set<int> landmarks;
  for (const SubmapId id : window_) {
    const ModelSubmap& submap = model_.submap(id);
    landmarks.insert(submap.landmarks.begin(), submap.landmarks.end());
  }
  for (const int landmark : landmarks) AddLandmark(landmark);
}

void WindowProblem::AddLandmark(int index) {
  const ModelLandmark& landmark = model_.landmarks()[index];
  const int point = static_cast<int>(problem_.points.size());
  const size_t before = problem_.observations.size();
  for (const LandmarkSight& sight : landmark.sights) {
    const ModelSubmap& submap = model_.submap(sight.submap);
    const int in_submap = MapModel::LandmarkIndex(*submap.refined, sight.track);
    const std::span<const ModelSight> sights = submap.sights[in_submap];
    for (size_t i = 0; i < sights.size(); ++i) {
      const Observation& raw =
          submap.refined->raw->keyframes[sights[i].keyframe].observations[sights[i].observation];
      BundleObservation observation;
      observation.camera = CameraIndex(sight.submap, sights[i].keyframe);
      observation.point = point;
      observation.pixel = raw.pixel.cast<double>();
      observation.sigma_px = raw.sigma_px;
      observation.inlier = sights[i].inlier;
      problem_.observations.push_back(observation);
      names_.push_back({sight.submap, in_submap, static_cast<int>(i)});
    }
  }
  if (problem_.observations.size() < before + 2) {
    problem_.observations.resize(before);
    names_.resize(before);
    return;
  }
  problem_.points.push_back({landmark.point_in_world});
  point_landmarks_.push_back(index);
}

int WindowProblem::CameraIndex(SubmapId id, int keyframe) {
  const std::pair<SubmapId, int> camera = model_.CameraOf(id, keyframe);
  const uint64_t key =
      (static_cast<uint64_t>(camera.first.value()) << 16) | static_cast<uint64_t>(camera.second);
  const auto [it, inserted] = cameras_.emplace(key, static_cast<int>(problem_.cameras.size()));
  if (!inserted) return it->second;
  BundleCamera bundle_camera;
  bundle_camera.world_from_camera = model_.submap(camera.first).world_from_camera[camera.second];
  bundle_camera.model = model_.submap(camera.first).camera.get();
  bundle_camera.fixed = !IsFree(camera);
  problem_.cameras.push_back(bundle_camera);
  camera_names_.push_back(camera);
  return it->second;
}

bool WindowProblem::IsFree(const std::pair<SubmapId, int>& camera) const {
  if (window_.contains(camera.first)) return true;
  const ModelSubmap& submap = model_.submap(camera.first);
  return submap.successor && window_.contains(*submap.successor) &&
         camera.second + 1 == static_cast<int>(submap.world_from_camera.size());
}

void WindowProblem::FixGauge() {
  AddMetricDistances();
  const bool held = std::any_of(problem_.cameras.begin(), problem_.cameras.end(),
                                [](const BundleCamera& camera) { return camera.fixed; });
  if (held || camera_names_.empty()) return;
  const int first = static_cast<int>(std::min_element(camera_names_.begin(), camera_names_.end()) -
                                     camera_names_.begin());
  problem_.cameras[first].fixed = true;
  if (!problem_.distances.empty()) return;
  DistancePrior scale{first, first, 0, kScaleGaugeSigma};
  for (size_t i = 0; i < problem_.cameras.size(); ++i) {
    const double distance = (problem_.cameras[i].world_from_camera.translation -
                             problem_.cameras[first].world_from_camera.translation)
                                .norm();
    if (distance <= scale.distance) continue;
    scale.camera_b = static_cast<int>(i);
    scale.distance = distance;
  }
  if (scale.distance > 0) problem_.distances.push_back(scale);
  origin_ = first;
}

void WindowProblem::KeepUnitOfWorld() {
  if (!origin_) return;
  std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> moved;
  for (size_t i = 0; i < camera_names_.size(); ++i) {
    const auto& [id, keyframe] = camera_names_[i];
    moved.emplace_back(model_.submap(id).world_from_camera[keyframe].translation,
                       problem_.cameras[i].world_from_camera.translation);
  }
  const Similarity3 change =
      KeepUnit(problem_.cameras[*origin_].world_from_camera.translation, moved);
  for (BundleCamera& camera : problem_.cameras) {
    camera.world_from_camera = change * camera.world_from_camera;
  }
  for (BundlePoint& point : problem_.points) point.point_in_world = change * point.point_in_world;
}

void WindowProblem::AddLenses() {
  const auto held = std::count_if(problem_.cameras.begin(), problem_.cameras.end(),
                                  [](const BundleCamera& camera) { return camera.fixed; });
  if (options_.min_lens_keyframes == 0 || held > 1) return;
  std::map<std::pair<AgentId, SessionId>, std::vector<int>> cameras_of;
  for (size_t i = 0; i < problem_.cameras.size(); ++i) {
    const SubmapKey& key = model_.submap(camera_names_[i].first).refined->raw->key;
    cameras_of[{key.agent, key.session}].push_back(static_cast<int>(i));
  }
  std::map<std::pair<AgentId, SessionId>, size_t> redundant;
  for (const SubmapId id : window_) {
    const RefinedSubmap& refined = *model_.submap(id).refined;
    redundant[{refined.raw->key.agent, refined.raw->key.session}] +=
        refined.redundant_keyframes.size();
  }
  for (const auto& [session, cameras] : cameras_of) {
    if (cameras.size() + redundant[session] < static_cast<size_t>(options_.min_lens_keyframes)) {
      continue;
    }
    const ModelSubmap& submap = model_.submap(camera_names_[cameras.front()].first);
    if (options_.trust_distortion && submap.refined->camera->has_distortion()) continue;
    if (model_.MainComponentOf(submap.refined->id) != submap.component) continue;
    for (const int camera : cameras) {
      problem_.cameras[camera].lens = static_cast<int>(problem_.lenses.size());
    }
    problem_.lenses.push_back(
        MakeLens(submap.camera, *submap.refined->camera, options_.lens_corner_sigma_px));
    lens_names_.push_back(submap.refined->id);
  }
}

void WindowProblem::AddMetricDistances() {
  const std::vector<SubmapId> ids(window_.begin(), window_.end());
  for (const auto& [id, measurement] : MeasureScales(options_.metric, model_, ids)) {
    const std::vector<Rigid3>& cameras = model_.submap(id).world_from_camera;
    DistancePrior prior{CameraIndex(id, 0), 0, 0, measurement.sigma};
    for (size_t k = 1; k < cameras.size(); ++k) {
      if (IsRedundant(*model_.submap(id).refined, static_cast<int>(k))) continue;
      const double distance = (cameras[k].translation - cameras[0].translation).norm();
      if (distance <= prior.distance) continue;
      prior.distance = distance;
      prior.camera_b = CameraIndex(id, static_cast<int>(k));
    }
    if (prior.distance < options_.min_metric_path_of_depth * SceneDepth(id)) continue;
    prior.distance *= std::exp(measurement.log_scale);
    problem_.distances.push_back(prior);
  }
}

void WindowProblem::AddFixes() {
  std::vector<SitePoint> points;
  for (const PositionTerm& term : positions_->terms) points.push_back(term.point);
  const std::vector<double> weights =
      SiteWeights(options_.positions, SiteChi2(points, Similarity3::Identity()));
  struct Pull {
    Eigen::Vector3d information = Eigen::Vector3d::Zero();
    Eigen::Vector3d weighted_sum = Eigen::Vector3d::Zero();
  };
  std::map<int, Pull> pulls;
  for (size_t i = 0; i < points.size(); ++i) {
    const PositionTerm& term = positions_->terms[i];
    if (term.control_point >= 0) continue;
    const int camera = CameraIndex(term.submap, Essential(term.submap, term.keyframe));
    const Eigen::Vector3d antenna_from_camera =
        points[i].in_world - problem_.cameras[camera].world_from_camera.translation;
    const Eigen::Vector3d information =
        weights[i] * points[i].share * points[i].site_covariance.diagonal().cwiseInverse();
    pulls[camera].information += information;
    pulls[camera].weighted_sum += information.cwiseProduct(points[i].in_site - antenna_from_camera);
  }
  for (const auto& [camera, pull] : pulls) {
    problem_.cameras[camera].prior =
        PositionPrior{pull.weighted_sum.cwiseQuotient(pull.information), 1.0,
                      pull.information.cwiseSqrt().cwiseInverse()};
  }
}

int WindowProblem::Essential(SubmapId id, double keyframe) const {
  const RefinedSubmap& refined = *model_.submap(id).refined;
  const int nearest = static_cast<int>(std::lround(keyframe));
  const int before = EssentialKeyframeBefore(refined, nearest);
  const int behind = EssentialKeyframeBehind(refined, nearest);
  return keyframe - before < behind - keyframe ? before : behind;
}

std::optional<Eigen::Vector2d> WindowProblem::PixelIn(int essential,
                                                      const SurveyedPoint::Sight& sight,
                                                      const Eigen::Vector3d& point_in_world) const {
  if (sight.keyframe == essential) return sight.pixel;
  const ModelSubmap& submap = model_.submap(sight.submap);
  const Rigid3& own = submap.world_from_camera[sight.keyframe];
  const std::optional<Eigen::Vector3d> bearing = submap.camera->Unproject(sight.pixel);
  if (!bearing) return std::nullopt;
  const double distance = (point_in_world - own.translation).norm();
  return submap.camera->Project(submap.world_from_camera[essential].Inverse() *
                                (own * Eigen::Vector3d(distance * *bearing)));
}

void WindowProblem::AddSurveyedPoint(const SurveyedPoint& surveyed) {
  const int point = static_cast<int>(problem_.points.size());
  problem_.points.push_back({surveyed.position_in_site, true});
  const double sigma_m = std::sqrt(static_cast<double>(surveyed.sights.size())) * surveyed.sigma_m;
  for (const SurveyedPoint::Sight& sight : surveyed.sights) {
    const int keyframe = Essential(sight.submap, sight.keyframe);
    const auto pixel = PixelIn(keyframe, sight, surveyed.position_in_site);
    if (!pixel) continue;
    BundleObservation observation;
    observation.camera = CameraIndex(sight.submap, keyframe);
    observation.point = point;
    observation.pixel = *pixel;
    observation.sigma_px = sight.sigma_px;
    const BundleCamera& camera = problem_.cameras[observation.camera];
    Matrix23d jacobian;
    const bool projects =
        camera.model
            ->Project(camera.world_from_camera.rotation.conjugate() *
                          (surveyed.position_in_site - camera.world_from_camera.translation),
                      &jacobian)
            .has_value();
    if (projects) {
      observation.sigma_px =
          std::hypot(sight.sigma_px, sigma_m * jacobian.norm() / std::numbers::sqrt2);
    }
    observation.inlier =
        projects && ReprojectionChi2(problem_, observation) < options_.control_point_chi2;
    problem_.observations.push_back(observation);
  }
}

double WindowProblem::SceneDepth(SubmapId id) const {
  const ModelSubmap& submap = model_.submap(id);
  std::vector<double> depths;
  for (const int landmark : submap.landmarks) {
    depths.push_back(
        (model_.landmarks()[landmark].point_in_world - submap.world_from_camera.front().translation)
            .norm());
  }
  if (depths.empty()) return 0;
  std::nth_element(depths.begin(), depths.begin() + depths.size() / 2, depths.end());
  return depths[depths.size() / 2];
}

template <typename Function>
void WindowProblem::ForEachLandmark(const Function& function) const {
  size_t begin = 0;
  while (begin < names_.size()) {
    size_t end = begin;
    const int point = problem_.observations[begin].point;
    while (end < names_.size() && problem_.observations[end].point == point) ++end;
    function(begin, end);
    begin = end;
  }
}

void WindowProblem::Retriangulate() {
  const double scene_depth = MedianDepth(problem_);
  ForEachLandmark([this, scene_depth](size_t begin, size_t end) {
    int inliers = 0;
    for (size_t i = begin; i < end; ++i) inliers += problem_.observations[i].inlier ? 1 : 0;
    if (inliers < 2) TriangulatePoint(options_.triangulation, begin, end, scene_depth);
  });
}

void WindowProblem::TriangulateAnew() {
  const double scene_depth = MedianDepth(problem_);
  TriangulationOptions options = options_.triangulation;
  options.inlier_chi2 = options_.bundle.outlier_chi2;
  ForEachLandmark(
      [&, this](size_t begin, size_t end) { TriangulatePoint(options, begin, end, scene_depth); });
}

void WindowProblem::TriangulatePoint(const TriangulationOptions& options, size_t begin, size_t end,
                                     double scene_depth) {
  std::vector<TrackSight> sights;
  for (size_t i = begin; i < end; ++i) {
    const BundleObservation& observation = problem_.observations[i];
    const BundleCamera& camera = problem_.cameras[observation.camera];
    sights.push_back(
        {{camera.world_from_camera, camera.model}, observation.pixel, observation.sigma_px});
  }
  const auto point = TriangulateTrack(options, sights, std::nullopt, scene_depth);
  if (!point) return;
  problem_.points[problem_.observations[begin].point].point_in_world = point->point_in_world;
  for (size_t i = begin; i < end; ++i) problem_.observations[i].inlier = point->inliers[i - begin];
}

void WindowProblem::WriteBack() {
  KeepUnitOfWorld();
  for (size_t i = 0; i < camera_names_.size(); ++i) {
    if (problem_.cameras[i].fixed) continue;
    model_.SetCamera(camera_names_[i].first, camera_names_[i].second,
                     problem_.cameras[i].world_from_camera);
  }
  for (size_t i = 0; i < lens_names_.size(); ++i) {
    model_.SetCameraModel(lens_names_[i], problem_.lenses[i].model);
  }
  for (size_t i = 0; i < point_landmarks_.size(); ++i) {
    model_.SetLandmark(point_landmarks_[i], problem_.points[i].point_in_world);
  }
  for (size_t i = 0; i < names_.size(); ++i) {
    model_.SetInlier(names_[i].submap, names_[i].landmark, names_[i].sight,
                     problem_.observations[i].inlier);
  }
  for (const SubmapId id : window_) model_.FitSubmapToCameras(id);
  for (const SubmapId id : window_) {
    const ModelSubmap& submap = model_.submap(id);
    model_.CarryRedundantKeyframes(id);
    // The last keyframe of the one and the first of the other are the window's, too.
    if (submap.link && !window_.contains(submap.link->a)) {
      model_.CarryRedundantKeyframes(submap.link->a);
    }
    if (submap.successor && !window_.contains(*submap.successor)) {
      model_.CarryRedundantKeyframes(*submap.successor);
    }
  }
}

}  // namespace portolan
