// How much a hypothesis a_from_b explains: a-contrario evidence of matches, by rays and landmark
// covariances.
#ifndef PORTOLAN_SERVER_VERIFICATION_PAIR_EVIDENCE_H_
#define PORTOLAN_SERVER_VERIFICATION_PAIR_EVIDENCE_H_

#include <optional>
#include <vector>

#include "common/geometry/similarity3.h"
#include "server/verification/descriptor_matcher.h"
#include "server/verification/submap_points.h"

namespace portolan {

// A landmark of one submap that should be seen along a ray of the other's camera.
struct RaySight {
  Eigen::Vector3d landmark_in_own = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
  const Rigid3* camera_from_other = nullptr;
  Eigen::Matrix3d camera_rotation_other = Eigen::Matrix3d::Identity();  // of camera_from_other
  Eigen::Vector3d bearing = Eigen::Vector3d::UnitZ();
  // Rows: an orthonormal basis of the plane across the bearing.
  Matrix23d across = Matrix23d::Zero();
  double variance_rad2 = 0;
};

// Both directions of a match; at least one is there.
struct MatchSights {
  std::optional<RaySight> of_a;  // a's landmark along b's ray
  std::optional<RaySight> of_b;  // b's landmark along a's ray
};

struct PairEvidenceOptions {
  // Standard deviation of a matched feature, pixels of its scale: detection and refinement of the
  // submap together.
  double sigma_px = 1.5;
  // A match whose squared Mahalanobis distance exceeds this is an outlier; chi-square, 2 degrees
  // of freedom: 11.8 is 99.73 %.
  double max_chi_squared = 11.8;
};

// Scores hypotheses over a fixed list of matches. The evidence of a match is the logarithm of the
// ratio of the probability density of its error, if the hypothesis is true, to that of a chance
// match anywhere in the image (cf. Moisan & Stival, IJCV 2004, for the a-contrario view): an inlier
// with a small covariance weighs up to about 9, one whose landmark has no depth, and which hence
// may lie anywhere along a line, less; an outlier weighs 0. Of the two directions the worse counts,
// for they are not independent.
class PairEvidence {
 public:
  // The submaps must outlive this. Matches without a landmark on either side never count.
  PairEvidence(const SubmapPoints& a, const SubmapPoints& b, std::vector<PointMatch> matches,
               const PairEvidenceOptions& options);

  const std::vector<PointMatch>& matches() const { return matches_; }

  // One entry a match, 0 for outliers.
  std::vector<double> EvidenceOfEach(const Similarity3& a_from_b) const;
  // Their sum; stops early and returns 0 as soon as `at_least` cannot be reached.
  double TotalEvidence(const Similarity3& a_from_b, double at_least) const;
  // The same, but every point counts once with the best of its matches (for lists that are not
  // one-to-one).
  double TotalEvidenceOfPoints(const Similarity3& a_from_b) const;

 private:
  // A similarity as a matrix, for the inner loop.
  struct Placement {
    explicit Placement(const Similarity3& similarity);
    Eigen::Matrix3d scaled_rotation;
    Eigen::Vector3d translation;
    double scale;
  };

  double EvidenceOf(const MatchSights& sights, const Placement& a_from_b,
                    const Placement& b_from_a) const;
  double EvidenceOf(const RaySight& sight, const Placement& other_from_own) const;

  const PairEvidenceOptions options_;
  std::vector<PointMatch> matches_;
  std::vector<MatchSights> sights_;
  size_t point_count_a_ = 0;
  size_t point_count_b_ = 0;
  double log_chance_density_ = 0;  // of a chance match, per steradian
  double most_evidence_ = 0;       // that one match can give
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_VERIFICATION_PAIR_EVIDENCE_H_
