// Finds known landmarks in a described keyframe.
#ifndef PORTOLAN_AGENT_REVISIT_LANDMARK_MATCHER_H_
#define PORTOLAN_AGENT_REVISIT_LANDMARK_MATCHER_H_

#include <optional>
#include <span>
#include <vector>

#include "agent/revisit/landmark_memory.h"
#include "common/base/status.h"
#include "common/bundle/resection.h"
#include "common/camera/camera_model.h"

namespace portolan {

struct LandmarkMatcherOptions {
  // Landmarks of the newest own submaps are left out, so many with the open one: the window holds
  // them itself.
  int newest_submaps_left_out = 2;
  // Radius of the search about the predicted place, share of the image's width.
  double search_radius_share = 0.05;
  // Descriptors differ by at most so many bits, and from the second best by so many less.
  int max_distance_bits = 60;
  int min_margin_bits = 10;
  // The distances of then and now differ by at most this factor, the directions by this angle.
  double max_distance_factor = 1.8;
  double max_view_angle_rad = 0.5;
  // Pixel error of a match, and the largest that the landmark's own uncertainty may add.
  double sigma_px = 1.0;
  double max_landmark_sigma_px = 6.0;
  // How many matches, and what share of them, must agree on one pose.
  ResectionOptions resection{.outlier_chi2 = 9.0};
  // They spread at least so far in every direction: standard deviation, share of the image's width.
  double min_spread_share = 0.06;
  // Of those, the best known in each cell count; cells across the image.
  int cells_across = 8;

  Status Validate() const;
};

// Thread-compatible, deterministic.
class LandmarkMatcher {
 public:
  LandmarkMatcher(const LandmarkMatcherOptions& options, const CameraModel& camera)
      : options_(options), camera_(camera) {}

  // From now on with this lens.
  void SetCamera(const CameraModel& camera) { camera_ = camera; }

  // What is seen of the component's landmarks from about world_from_camera; none if the matches do
  // not agree on a pose. sequence_number: of the open submap.
  std::vector<KnownSight> Match(const LandmarkMemory& memory, ComponentId component,
                                uint32_t sequence_number, const Rigid3& world_from_camera,
                                std::span<const Feature> features) const;

 private:
  class FeatureGrid;
  struct InView {
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
    double variance_px2 = 0;  // the larger one
  };
  struct Nearest {
    int feature = -1;
    int distance_bits = 0;
  };

  std::optional<InView> Predict(const KnownLandmark& landmark, const Rigid3& world_from_camera,
                                const Rigid3& camera_from_world) const;
  Nearest FindNearest(const KnownLandmark& landmark, const Eigen::Vector2d& pixel,
                      std::span<const Feature> features, const FeatureGrid& grid) const;
  // Those that agree on one pose near this one; none if they are too few.
  std::vector<KnownSight> Agreeing(const Rigid3& world_from_camera,
                                   const std::vector<KnownSight>& sights) const;
  bool IsSpread(const std::vector<KnownSight>& sights) const;
  std::vector<KnownSight> BestOfCells(const std::vector<KnownSight>& sights) const;

  const LandmarkMatcherOptions options_;
  CameraModel camera_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_REVISIT_LANDMARK_MATCHER_H_
