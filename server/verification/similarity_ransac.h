// Robust search for the similarity between two submaps that the most matches support.
#ifndef PORTOLAN_SERVER_VERIFICATION_SIMILARITY_RANSAC_H_
#define PORTOLAN_SERVER_VERIFICATION_SIMILARITY_RANSAC_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "server/verification/pair_evidence.h"

namespace portolan {

struct SimilarityRansacOptions {
  int max_iterations = 400;
  // The search ends when a better hypothesis is less likely than this.
  double max_miss_probability = 1e-3;
  bool fixed_scale = false;
  // Scales outside of [1 / max_scale, max_scale] are not believed.
  double max_scale = 20.0;
  uint32_t seed = 1;
};

struct SimilarityHypothesis {
  Similarity3 a_from_b;
  double evidence = 0;
};

// Improves a hypothesis from the matches that support it (indices); may give none.
using LocalOptimiser =
    std::function<std::optional<Similarity3>(const Similarity3&, const std::vector<size_t>&)>;

// Locally optimised RANSAC (Chum, Matas, Kittler, DAGM 2003) over minimal samples of three
// matches: the pose of b's camera from a's landmarks, that of a's camera from b's, with the scale
// from the depths (3D-2D), or the similarity of both triangles (3D-3D). Samples are drawn from the
// nearest descriptors first and from more and more of the list (PROSAC's order, Chum & Matas, CVPR
// 2005). `evidence` must have its matches in ascending distance. Deterministic by seed.
std::optional<SimilarityHypothesis> FindSimilarity(const SubmapPoints& a, const SubmapPoints& b,
                                                   const PairEvidence& evidence,
                                                   const LocalOptimiser& optimise,
                                                   const SimilarityRansacOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_VERIFICATION_SIMILARITY_RANSAC_H_
