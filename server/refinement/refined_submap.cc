#include "server/refinement/refined_submap.h"

#include <algorithm>
#include <optional>

namespace portolan {

std::vector<std::vector<bool>> AgreeingObservations(const RefinedSubmap& submap, double max_chi2) {
  std::vector<std::vector<bool>> agreeing;
  for (size_t k = 0; k < submap.raw->keyframes.size(); ++k) {
    const Rigid3 camera_from_submap = submap.submap_from_camera[k].Inverse();
    std::vector<bool>& marks = agreeing.emplace_back();
    for (const Observation& observation : submap.raw->keyframes[k].observations) {
      const RefinedLandmark* landmark = FindLandmark(submap, observation.track);
      std::optional<Eigen::Vector2d> pixel;
      if (landmark != nullptr) {
        pixel = submap.camera->Project(camera_from_submap * landmark->point_in_submap);
      }
      const double limit = max_chi2 * observation.sigma_px * observation.sigma_px;
      marks.push_back(pixel && (*pixel - observation.pixel.cast<double>()).squaredNorm() < limit);
    }
  }
  return agreeing;
}

bool IsRedundant(const RefinedSubmap& submap, int keyframe) {
  return std::binary_search(submap.redundant_keyframes.begin(), submap.redundant_keyframes.end(),
                            keyframe);
}

int EssentialKeyframeBefore(const RefinedSubmap& submap, int keyframe) {
  while (IsRedundant(submap, keyframe)) --keyframe;
  return keyframe;
}

int EssentialKeyframeBehind(const RefinedSubmap& submap, int keyframe) {
  while (IsRedundant(submap, keyframe)) ++keyframe;
  return keyframe;
}

const RefinedLandmark* FindLandmark(const RefinedSubmap& submap, TrackId track) {
  const auto it = std::lower_bound(
      submap.landmarks.begin(), submap.landmarks.end(), track,
      [](const RefinedLandmark& landmark, TrackId id) { return landmark.track < id; });
  return it == submap.landmarks.end() || it->track != track ? nullptr : &*it;
}

double MedianDepth(const RefinedSubmap& submap) {
  std::vector<double> distances;
  for (const RefinedLandmark& landmark : submap.landmarks) {
    distances.push_back(landmark.point_in_submap.norm());
  }
  if (distances.empty()) return 1.0;
  const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  return std::max(*middle, 1e-9);
}

}  // namespace portolan
