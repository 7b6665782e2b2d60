// LocalAdjustment's part that sets up the bundle adjustment of a window.
#include <algorithm>
#include <tuple>

#include "agent/local_adjustment/local_adjustment.h"

namespace portolan {
namespace {

// While all keyframes are free but the first, the distance of the farthest one is held so firmly.
constexpr double kScaleGaugeSigma = 1e-3;

}  // namespace

std::vector<TrackId> LocalAdjustment::MakeProblem(int first, int first_free,
                                                  BundleProblem* problem) const {
  AddCameras(first, first_free, problem);
  const double scene_depth = SceneDepth();
  std::vector<TrackId> tracks;
  const std::vector<Sight> sights = CollectSights(first, first_free);
  for (size_t begin = 0, end = 0; begin < sights.size(); begin = end) {
    const TrackId track = sights[begin].track;
    while (end < sights.size() && sights[end].track == track) ++end;
    const size_t points = problem->points.size();
    AddPoint(std::span(sights).subspan(begin, end - begin), first, scene_depth, problem);
    if (problem->points.size() > points) tracks.push_back(track);
  }
  if (static_cast<int>(tracks.size()) < options_.min_points) tracks.clear();
  return tracks;
}

void LocalAdjustment::AddCameras(int first, int first_free, BundleProblem* problem) const {
  for (int i = first; i < static_cast<int>(keyframes_.size()); ++i) {
    BundleCamera camera;
    camera.world_from_camera = keyframes_[i].window_from_camera;
    camera.model = &camera_;
    camera.fixed = i < first_free;
    problem->cameras.push_back(camera);
  }
  if (first_free - first > 1) return;
  DistancePrior scale{0, 0, 0, kScaleGaugeSigma};
  for (size_t i = 1; i < problem->cameras.size(); ++i) {
    const double distance = (problem->cameras[i].world_from_camera.translation -
                             problem->cameras[0].world_from_camera.translation)
                                .norm();
    if (distance <= scale.distance) continue;
    scale.distance = distance;
    scale.camera_b = static_cast<int>(i);
  }
  if (scale.distance > 0) problem->distances.push_back(scale);
}

// Of the tracks that a free keyframe or the last one sees, and another one as well; ascending
// track and keyframe.
std::vector<LocalAdjustment::Sight> LocalAdjustment::CollectSights(int first,
                                                                   int first_free) const {
  const int size = static_cast<int>(keyframes_.size());
  std::vector<Sight> sights;
  for (int i = first; i < size; ++i) {
    for (const LiveSight& sight : keyframes_[i].sights) {
      sights.push_back({sight.observation.track, i, &sight});
    }
  }
  std::sort(sights.begin(), sights.end(), [](const Sight& a, const Sight& b) {
    return std::tie(a.track, a.keyframe) < std::tie(b.track, b.keyframe);
  });
  const int first_wanted = std::min(first_free, size - 1);
  size_t kept = 0;
  for (size_t begin = 0, end = 0; begin < sights.size(); begin = end) {
    while (end < sights.size() && sights[end].track == sights[begin].track) ++end;
    if (end - begin < 2 || sights[end - 1].keyframe < first_wanted) continue;
    kept = std::copy(sights.begin() + begin, sights.begin() + end, sights.begin() + kept) -
           sights.begin();
  }
  sights.resize(kept);
  return sights;
}

void LocalAdjustment::AddPoint(std::span<const Sight> sights, int first, double scene_depth,
                               BundleProblem* problem) const {
  const size_t begin = problem->observations.size();
  const int index = static_cast<int>(problem->points.size());
  for (const Sight& sight : sights) {
    problem->observations.push_back({sight.keyframe - first, index, PixelOf(*sight.sight),
                                     double{sight.sight->observation.sigma_px}, false,
                                     sight.sight->row_motion.cast<double>()});
  }
  problem->points.emplace_back();
  int inliers = 0;
  if (const WindowPoint* known = FindPoint(sights.front().track)) {
    problem->points.back().point_in_world = known->point_in_window;
    for (size_t i = begin; i < problem->observations.size(); ++i) {
      BundleObservation& observation = problem->observations[i];
      observation.inlier =
          ReprojectionChi2(*problem, observation) < options_.triangulation.inlier_chi2;
      inliers += observation.inlier ? 1 : 0;
    }
  }
  if (inliers >= 2 && 2 * inliers >= static_cast<int>(sights.size())) return;
  std::vector<TrackSight> rays;
  for (size_t i = begin; i < problem->observations.size(); ++i) {
    const BundleObservation& observation = problem->observations[i];
    rays.push_back({{problem->cameras[observation.camera].world_from_camera, &camera_},
                    observation.pixel,
                    observation.sigma_px});
  }
  const auto point = TriangulateTrack(options_.triangulation, rays, std::nullopt, scene_depth);
  if (!point) {
    problem->points.pop_back();
    problem->observations.resize(begin);
    return;
  }
  problem->points.back().point_in_world = point->point_in_world;
  for (size_t i = 0; i < rays.size(); ++i) {
    problem->observations[begin + i].inlier = point->inliers[i];
  }
}

// After the points of tracks; each sight has its own.
void LocalAdjustment::AddKnown(int first, int first_free, BundleProblem* problem) const {
  for (int i = first_free; i < static_cast<int>(keyframes_.size()); ++i) {
    for (const KnownSight& sight : keyframes_[i].known) {
      problem->observations.push_back(
          {i - first, static_cast<int>(problem->points.size()), sight.pixel, sight.sigma_px, true});
      problem->points.push_back({sight.point_in_world, true});
    }
  }
}

}  // namespace portolan
