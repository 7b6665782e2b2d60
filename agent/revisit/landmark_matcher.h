// Finds known landmarks in a keyframe.
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
  // Radius of the search about the predicted place, share of the image's width.
  double search_radius_share = 0.05;
  // Descriptors differ by at most so many bits, and by so many more for the second best.
  int max_distance_bits = 60;
  int min_margin_bits = 10;
  // The distances of then and now differ by at most this factor, the directions by this angle.
  double max_distance_factor = 1.8;
  double max_view_angle_rad = 0.8;
  // Pixel error of a match, and the largest that the landmark's own uncertainty may add.
  double sigma_px = 1.5;
  double max_landmark_sigma_px = 6.0;
  // Of the pose from the matches.
  ResectionOptions resection{.outlier_chi2 = 9.0, .min_inliers = 12, .min_inlier_share = 0.4};
  // Inliers spread at least so far, share of the image's width (the smaller standard deviation).
  double min_spread_share = 0.06;

  Status Validate() const;
};

struct Revisit {
  Rigid3 world_from_camera;
  std::vector<KnownSight> sights;
};

// Thread-compatible, deterministic.
class LandmarkMatcher {
 public:
  LandmarkMatcher(const LandmarkMatcherOptions& options, const CameraModel& camera)
      : options_(options), camera_(camera) {}

  // Groups up to `last_group` count.
  std::optional<Revisit> Match(const LandmarkMemory& memory, ComponentId component,
                               uint64_t last_group, const Rigid3& world_from_camera,
                               std::span<const Feature> features) const;
  // The pose that most of the sights agree with; the others are removed.
  std::optional<Rigid3> Verify(const Rigid3& start, std::vector<KnownSight>* sights) const;

 private:
  struct Candidate;

  const LandmarkMatcherOptions options_;
  const CameraModel camera_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_REVISIT_LANDMARK_MATCHER_H_
