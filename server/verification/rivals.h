// Repeated structure: is there a second place where the submaps fit nearly as well?
#ifndef PORTOLAN_SERVER_VERIFICATION_RIVALS_H_
#define PORTOLAN_SERVER_VERIFICATION_RIVALS_H_

#include "server/verification/pair_evidence.h"
#include "server/verification/similarity_ransac.h"

namespace portolan {

struct RivalOptions {
  // Hypotheses that move the matched points by less than this angle, as the cameras see it
  // (median), are the same.
  double distinct_rad = 0.03;
  // Shifts tried at most.
  int max_shifts = 80;
};

// Evidence of the best hypothesis distinct from `winner`, as a share of the winner's, both over the
// same look-alikes. Two families of rivals are tried: `winner` shifted so that it satisfies one of
// the look-alikes it explains otherwise (lattices, rows of equal objects), and hypotheses found by
// RANSAC in the putative matches that `winner` does not explain (a second object).
double BestRivalShare(const SubmapPoints& a, const SubmapPoints& b,
                      const DescriptorMatches& matches, const Similarity3& winner,
                      const PairEvidenceOptions& evidence_options,
                      const SimilarityRansacOptions& ransac_options, const RivalOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_VERIFICATION_RIVALS_H_
