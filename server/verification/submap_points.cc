#include "server/verification/submap_points.h"

#include <algorithm>
#include <cmath>

#include "absl/container/flat_hash_map.h"

namespace portolan {
namespace {

class PointsBuilder {
 public:
  explicit PointsBuilder(const RefinedSubmap& submap) : submap_(submap) {
    result_.submap = &submap;
  }

  void AddFeatures(int keyframe_index, size_t max_features) {
    const std::vector<Feature>& features = submap_.raw->keyframes[keyframe_index].features;
    const size_t count = std::min(features.size(), max_features);
    if (count == 0) return;
    DescribedKeyframe described;
    described.keyframe = keyframe_index;
    for (size_t i = 0; i < count; ++i) {
      const Feature& feature = features[i * features.size() / count];
      const int point = PointOf(feature, keyframe_index);
      if (point < 0) continue;
      described.descriptors.Append(feature.descriptor);
      described.points.push_back(point);
      described.pixels.push_back(feature.pixel);
      described.half_octaves.push_back(feature.half_octave);
    }
    if (!described.points.empty()) result_.keyframes.push_back(std::move(described));
  }

  // Sights of the described tracks in the keyframes without descriptions.
  void AddObservations(int keyframe_index) {
    for (const Observation& observation : submap_.raw->keyframes[keyframe_index].observations) {
      const auto it = point_of_track_.find(observation.track);
      if (it == point_of_track_.end()) continue;
      SubmapPoint& point = result_.points[it->second];
      const bool valid = observation.pixel.allFinite() && observation.sigma_px > 0 &&
                         std::isfinite(observation.sigma_px);
      if (!valid || ViewIn(point, keyframe_index) != nullptr) continue;
      point.views.push_back(
          {keyframe_index, observation.pixel.cast<double>(), observation.sigma_px, std::nullopt});
    }
  }

  SubmapPoints Finish() {
    for (SubmapPoint& point : result_.points) {
      std::sort(point.views.begin(), point.views.end(),
                [](const PointView& a, const PointView& b) { return a.keyframe < b.keyframe; });
    }
    for (const Rigid3& submap_from_camera : submap_.submap_from_camera) {
      result_.camera_from_submap.push_back(submap_from_camera.Inverse());
    }
    return std::move(result_);
  }

 private:
  // Index of the feature's point, made if need be, with a sight in this keyframe; -1 if the
  // camera cannot have seen it.
  int PointOf(const Feature& feature, int keyframe_index) {
    if (feature.track) {
      const auto it = point_of_track_.find(*feature.track);
      if (it != point_of_track_.end() &&
          ViewIn(result_.points[it->second], keyframe_index) != nullptr) {
        return it->second;
      }
    }
    if (!feature.pixel.allFinite()) return -1;
    const Eigen::Vector2d pixel = feature.pixel.cast<double>();
    const std::optional<Eigen::Vector3d> bearing = submap_.camera->Unproject(pixel);
    if (!bearing) return -1;
    const double scale =
        feature.track ? 1.0 : std::exp2(0.5 * std::min<int>(feature.half_octave, 8));
    const int index = PointWith(feature.track);
    result_.points[index].views.push_back({keyframe_index, pixel, scale, bearing});
    return index;
  }

  int PointWith(const std::optional<TrackId>& track) {
    const int next = static_cast<int>(result_.points.size());
    if (track) {
      const auto [it, inserted] = point_of_track_.try_emplace(*track, next);
      if (!inserted) return it->second;
    }
    result_.points.push_back({track, track ? FindLandmark(*track) : nullptr, {}});
    return next;
  }

  const RefinedLandmark* FindLandmark(TrackId track) const {
    const auto it = std::lower_bound(
        submap_.landmarks.begin(), submap_.landmarks.end(), track,
        [](const RefinedLandmark& landmark, TrackId id) { return landmark.track < id; });
    return it != submap_.landmarks.end() && it->track == track ? &*it : nullptr;
  }

  const RefinedSubmap& submap_;
  SubmapPoints result_;
  absl::flat_hash_map<TrackId, int> point_of_track_;
};

}  // namespace

std::optional<SubmapPoints> MakeSubmapPoints(const RefinedSubmap& submap, int max_features) {
  const bool complete = submap.raw && submap.camera && submap.quarantine_reason.empty() &&
                        submap.raw->keyframes.size() == submap.submap_from_camera.size();
  if (!complete || submap.landmarks.empty()) return std::nullopt;
  PointsBuilder builder(submap);
  const int count = static_cast<int>(submap.raw->keyframes.size());
  for (int k = 0; k < count; ++k) builder.AddFeatures(k, max_features);
  for (int k = 0; k < count; ++k) builder.AddObservations(k);
  SubmapPoints points = builder.Finish();
  if (points.keyframes.empty()) return std::nullopt;
  return points;
}

const PointView* ViewIn(const SubmapPoint& point, int keyframe) {
  for (const PointView& view : point.views) {
    if (view.keyframe == keyframe) return &view;
  }
  return nullptr;
}

}  // namespace portolan
