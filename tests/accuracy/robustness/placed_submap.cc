#include "tests/accuracy/robustness/placed_submap.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "common/trajectory/alignment.h"

namespace portolan {
namespace {

constexpr int kMinSequenceDistance = 3;
constexpr double kMaxNearAngle = 20 * M_PI / 180;
constexpr double kMaxNearDistanceOfDepth = 0.25;

}  // namespace

std::optional<PlacedByTruth> PlaceByTruth(std::shared_ptr<const RefinedSubmap> refined,
                                          const Trajectory& groundtruth) {
  if (!refined->quarantine_reason.empty()) return std::nullopt;
  PlacedByTruth placed;
  std::vector<Eigen::Vector3d> estimate, truth;
  std::optional<Rigid3> first;
  for (size_t k = 0; k < refined->raw->keyframes.size(); ++k) {
    const auto pose = InterpolatePose(groundtruth, refined->raw->keyframes[k].time);
    if (!pose) continue;
    if (k == 0) first = pose;
    estimate.push_back(refined->submap_from_camera[k].translation);
    truth.push_back(pose->translation);
    if (!refined->raw->keyframes[k].features.empty()) placed.world_from_described.push_back(*pose);
  }
  const auto aligned = AlignPoints(estimate, truth, AlignmentMode::kSim3);
  if (!aligned || !first) return std::nullopt;
  placed.world_from_submap = Similarity3::FromRigid(*first, aligned->scale);
  double dot = 0, squares = 0, squares_truth = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    const Eigen::Vector3d in_first = first->Inverse() * truth[i];
    dot += in_first.dot(estimate[i]);
    squares += estimate[i].squaredNorm();
    squares_truth += in_first.squaredNorm();
  }
  placed.motion_agreement = dot / std::sqrt(squares * squares_truth);
  std::vector<double> depths;
  for (const RefinedLandmark& landmark : refined->landmarks) {
    depths.push_back(aligned->scale * landmark.point_in_submap.norm());
  }
  std::nth_element(depths.begin(), depths.begin() + depths.size() / 2, depths.end());
  placed.depth_m = depths[depths.size() / 2];
  placed.refined = std::move(refined);
  return placed;
}

bool IsNear(const PlacedByTruth& a, const PlacedByTruth& b) {
  for (const Rigid3& camera_a : a.world_from_described) {
    for (const Rigid3& camera_b : b.world_from_described) {
      const double distance = (camera_a.translation - camera_b.translation).norm();
      if (distance < kMaxNearDistanceOfDepth * std::min(a.depth_m, b.depth_m) &&
          camera_a.rotation.angularDistance(camera_b.rotation) < kMaxNearAngle) {
        return true;
      }
    }
  }
  return false;
}

bool IsCandidate(const RefinedSubmap& a, const RefinedSubmap& b) {
  const SubmapKey &x = a.raw->key, &y = b.raw->key;
  if (x.agent != y.agent || x.session != y.session) return true;
  return std::abs(static_cast<int>(x.sequence_number) - static_cast<int>(y.sequence_number)) >=
         kMinSequenceDistance;
}

}  // namespace portolan
