// Two refined submaps of one synthetic scene, without images: points with random descriptors that
// are disturbed in every view.
#ifndef PORTOLAN_TESTS_SERVER_VERIFICATION_SYNTHETIC_PAIR_H_
#define PORTOLAN_TESTS_SERVER_VERIFICATION_SYNTHETIC_PAIR_H_

#include "common/geometry/similarity3.h"
#include "server/refinement/refined_submap.h"

namespace portolan {

enum class SceneShape { kVolume, kPlane, kLattice };

struct SyntheticPairOptions {
  uint32_t seed = 1;
  SceneShape shape = SceneShape::kVolume;
  int points = 250;
  // Points that only one of the submaps has, each.
  int private_points = 60;
  // The common points lie right of this, in scene units; all lie between -4 and 4.
  double common_from_x = -4;
  // All points look the same.
  bool identical_descriptors = false;
  // Bits of 256 that change from view to view.
  int noise_bits = 14;
  double noise_px = 0.5;
  // b's unit in a's units; 1 and metric makes both metric.
  double scale = 1.8;
  bool metric = false;
  // Path of each camera in scene units; the points lie 4 to 8 in front of it.
  double path = 0.8;
  // Where b's camera starts in a's.
  Rigid3 a_from_b = {
      Eigen::Quaterniond(Eigen::AngleAxisd(0.15, Eigen::Vector3d(0.3, 1, 0.2).normalized())),
      Eigen::Vector3d(-0.6, 0.2, 0.3)};
  CameraIntrinsics camera = {
      640, 480, 420, 420, 320, 240, DistortionModel::kRadTan, {-0.2, 0.04, 0.0002, -0.0003, 0}};
};

struct SyntheticPair {
  RefinedSubmap a;
  RefinedSubmap b;
  Similarity3 a_from_b;
};

// Track t of a and track t + 1000 of b are the same point.
SyntheticPair MakeSyntheticPair(const SyntheticPairOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_TESTS_SERVER_VERIFICATION_SYNTHETIC_PAIR_H_
