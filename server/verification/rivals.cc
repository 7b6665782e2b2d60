#include "server/verification/rivals.h"

#include <algorithm>
#include <cmath>

namespace portolan {
namespace {

// A match of two landmarks and the camera of a in which it was made.
struct LandmarkPair {
  const RefinedLandmark* in_a;
  const RefinedLandmark* in_b;
  const Rigid3* camera_from_a;
};

std::vector<LandmarkPair> LandmarkPairs(const SubmapPoints& a, const SubmapPoints& b,
                                        const std::vector<PointMatch>& matches) {
  std::vector<LandmarkPair> pairs;
  for (const PointMatch& match : matches) {
    const RefinedLandmark* in_a = a.points[match.a].landmark;
    const RefinedLandmark* in_b = b.points[match.b].landmark;
    if (in_a == nullptr || in_b == nullptr) continue;
    pairs.push_back({in_a, in_b, &a.camera_from_submap[match.keyframe_a]});
  }
  return pairs;
}

// Median angle, seen from a's cameras, by which two hypotheses place b's points apart.
double MedianDisplacement(const std::vector<LandmarkPair>& pairs, const Similarity3& first,
                          const Similarity3& second) {
  std::vector<double> angles;
  for (const LandmarkPair& pair : pairs) {
    const Eigen::Vector3d& point = pair.in_b->point_in_submap;
    const Eigen::Vector3d u = *pair.camera_from_a * (first * point);
    const Eigen::Vector3d v = *pair.camera_from_a * (second * point);
    angles.push_back(std::atan2(u.cross(v).norm(), u.dot(v)));
  }
  if (angles.empty()) return 0;
  std::nth_element(angles.begin(), angles.begin() + angles.size() / 2, angles.end());
  return angles[angles.size() / 2];
}

// The matches that the hypothesis explains, or those that it does not.
std::vector<PointMatch> Explained(const PairEvidence& evidence, const Similarity3& hypothesis,
                                  bool explained) {
  const std::vector<double> of_each = evidence.EvidenceOfEach(hypothesis);
  std::vector<PointMatch> matches;
  for (size_t i = 0; i < of_each.size(); ++i) {
    if ((of_each[i] > 0) == explained) matches.push_back(evidence.matches()[i]);
  }
  return matches;
}

double BestShiftEvidence(const PairEvidence& look_alikes, const std::vector<LandmarkPair>& others,
                         const std::vector<LandmarkPair>& supporters, const Similarity3& winner,
                         const RivalOptions& options) {
  double best = 0;
  // Evenly over the list, which is ordered by point, so that no region is favoured.
  const size_t count = std::min<size_t>(others.size(), options.max_shifts);
  for (size_t i = 0; i < count; ++i) {
    const LandmarkPair& pair = others[i * others.size() / count];
    Similarity3 shifted = winner;
    shifted.translation += pair.in_a->point_in_submap - winner * pair.in_b->point_in_submap;
    if (MedianDisplacement(supporters, winner, shifted) < options.distinct_rad) continue;
    best = std::max(best, look_alikes.TotalEvidenceOfPoints(shifted));
  }
  return best;
}

}  // namespace

double BestRivalShare(const SubmapPoints& a, const SubmapPoints& b,
                      const DescriptorMatches& matches, const Similarity3& winner,
                      const PairEvidenceOptions& evidence_options,
                      const SimilarityRansacOptions& ransac_options, const RivalOptions& options) {
  const PairEvidence look_alikes(a, b, matches.alternatives, evidence_options);
  const double winner_evidence = look_alikes.TotalEvidenceOfPoints(winner);
  if (!(winner_evidence > 0)) return 1.0;
  const auto supporters = LandmarkPairs(a, b, Explained(look_alikes, winner, true));
  const auto others = LandmarkPairs(a, b, Explained(look_alikes, winner, false));
  double best = BestShiftEvidence(look_alikes, others, supporters, winner, options);

  const PairEvidence putative(a, b, matches.putative, evidence_options);
  const PairEvidence rest(a, b, Explained(putative, winner, false), evidence_options);
  const auto keep = [](const Similarity3&, const std::vector<size_t>&) {
    return std::optional<Similarity3>();
  };
  const auto rival = FindSimilarity(a, b, rest, keep, ransac_options);
  if (rival && MedianDisplacement(supporters, winner, rival->a_from_b) > options.distinct_rad) {
    best = std::max(best, look_alikes.TotalEvidenceOfPoints(rival->a_from_b));
  }
  return best / winner_evidence;
}

}  // namespace portolan
