// Geometric verification of a place candidate: are two submaps views of the same place, and how do
// they lie to each other?
#ifndef PORTOLAN_SERVER_VERIFICATION_VERIFIER_H_
#define PORTOLAN_SERVER_VERIFICATION_VERIFIER_H_

#include <optional>
#include <string>

#include "common/base/status.h"
#include "server/refinement/refined_submap.h"
#include "server/verification/closure.h"
#include "server/verification/descriptor_matcher.h"
#include "server/verification/guided_matcher.h"
#include "server/verification/pair_evidence.h"
#include "server/verification/rivals.h"
#include "server/verification/similarity_ransac.h"
#include "server/verification/submap_points.h"

namespace portolan {

struct VerifierOptions {
  // Features used of a keyframe; bounds time against hostile or odd submaps.
  int max_features = 1500;
  DescriptorMatcherOptions matcher;
  PairEvidenceOptions evidence;
  // max_iterations, max_scale, seed; the scale is fixed by the submaps, not here.
  SimilarityRansacOptions ransac;
  GuidedMatcherOptions guided;
  RivalOptions rivals;

  // Acceptance. The figures behind the defaults are in README.md.
  // Evidence, in nats, of the putative matches for the hypothesis (see pair_evidence.h), as found
  // and as refined.
  double min_evidence = 140.0;
  // Matched points after guided matching; of these, with a landmark on both sides.
  int min_inliers = 20;
  int min_landmark_matches = 15;
  // Inliers among the matches that guided matching found, and those among the landmarks that
  // should be visible.
  double min_inlier_share = 0.5;
  double min_visible_share = 0.15;
  // Of one place seen twice, about the same share of landmarks is found again all over the image;
  // of two places with an object in common, nearly all on the object and none beside it. Evenness
  // is the number of image cells with an inlier over that expected if inliers were spread at random
  // over the landmarks that should be visible.
  double min_evenness = 0.8;
  // It is asked only where less than this share of the landmarks that should be visible is found.
  double max_share_to_ask_evenness = 0.35;
  // Cells of an 8 x 6 grid over the image that inliers occupy, in each submap's best keyframe.
  int min_cells = 8;
  // A rival (see rivals.h) must have less than this share of the winner's evidence.
  double max_rival_share = 0.5;
  // Standard deviations of the result: rotation, logarithm of the scale, and translation relative
  // to the median distance of the matched points.
  double max_rotation_sigma_rad = 0.02;
  double max_log_scale_sigma = 0.1;
  double max_relative_translation_sigma = 0.05;
  // Log of the scale between two metric submaps; each is known to a few percent.
  double max_metric_log_scale = 0.2;
  // Between the directions of gravity, where both submaps know them.
  double max_gravity_error_rad = 0.15;

  Status Validate() const;
};

// Why a pair was refused and how far it came; for logs and metrics.
struct VerificationReport {
  // Empty if accepted, else one of a few fixed phrases.
  std::string refusal;
  int putative_matches = 0;
  int ransac_inliers = 0;
  double evidence = 0;
  int inliers = 0;
  int landmark_matches = 0;
  double inlier_share = 0;
  double visible_share = 0;
  double evenness = 0;  // about 1 if inliers lie all over what should be visible
  int cells = 0;        // the smaller of both sides
  double rival_share = 0;
  double rotation_sigma_rad = 0;
  double log_scale_sigma = 0;
  double relative_translation_sigma = 0;
};

// Thread rule: immutable after creation, hence thread-safe. Deterministic: the answer depends on
// the two submaps and the options only.
class Verifier {
 public:
  static StatusOr<Verifier> Create(const VerifierOptions& options);

  // The verified relation, or no value if the submaps do not certainly show the same place. Every
  // LandmarkMatch names tracks that have a landmark in both submaps; no track appears twice. The
  // scale is estimated for metric submaps as well: their own scales have errors of some percent.
  std::optional<Closure> Verify(const RefinedSubmap& a, const RefinedSubmap& b,
                                VerificationReport* report = nullptr) const;

  // The same in two steps, for a submap that is compared with several. The points refer to it; no
  // value if there is nothing to match.
  std::optional<SubmapPoints> PointsOf(const RefinedSubmap& submap) const;
  std::optional<Closure> Verify(const std::optional<SubmapPoints>& a,
                                const std::optional<SubmapPoints>& b,
                                VerificationReport* report = nullptr) const;

 private:
  explicit Verifier(const VerifierOptions& options) : options_(options) {}

  VerifierOptions options_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_VERIFICATION_VERIFIER_H_
