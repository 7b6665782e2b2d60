#include "server/verification/similarity_ransac.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "server/verification/three_point_pose.h"

namespace portolan {
namespace {

constexpr size_t kFirstPool = 12;       // matches in the first samples
constexpr int kIterationsPerMatch = 2;  // then one more match after so many

using Sample = std::array<size_t, 3>;

// One half of a match: its point in one submap and where it was matched.
struct End {
  const SubmapPoint* point;
  int keyframe;
};

// Relative weight of a landmark's depth from a camera: 1 / variance of the logarithm of the
// depth, with a floor so that no single point rules.
double LogDepthWeight(const RefinedLandmark& landmark, const Eigen::Vector3d& point_in_camera,
                      const Rigid3& camera_from_submap) {
  const double depth_squared = point_in_camera.squaredNorm();
  const Eigen::Vector3d ray =
      camera_from_submap.rotation.conjugate() * point_in_camera / std::sqrt(depth_squared);
  return 1.0 / (landmark.covariance.SquareOf(ray) / depth_squared + 0.05 * 0.05);
}

class Sampler {
 public:
  Sampler(const SubmapPoints& a, const SubmapPoints& b, const PairEvidence& evidence,
          const SimilarityRansacOptions& options)
      : a_(a), b_(b), evidence_(evidence), options_(options), random_(options.seed) {}

  Sample Draw(int iteration) {
    const size_t count = evidence_.matches().size();
    const size_t pool =
        std::min(count, std::max<size_t>(kFirstPool, iteration / kIterationsPerMatch));
    Sample sample;
    do {
      for (size_t& index : sample) index = random_() % pool;
    } while (sample[0] == sample[1] || sample[0] == sample[2] || sample[1] == sample[2]);
    return sample;
  }

  // Hypotheses of one sample; kind 0 and 1: 3D-2D in b's and a's camera, 2: 3D-3D.
  std::vector<Similarity3> Solve(const Sample& sample, int kind) const {
    if (kind == 2) return SolveTriangles(sample);
    std::array<End, 3> ends_a = Ends(sample, true);
    std::array<End, 3> ends_b = Ends(sample, false);
    if (kind == 0) return SolvePose(ends_a, b_, ends_b);
    std::vector<Similarity3> hypotheses = SolvePose(ends_b, a_, ends_a);
    for (Similarity3& hypothesis : hypotheses) hypothesis = hypothesis.Inverse();
    return hypotheses;
  }

 private:
  std::array<End, 3> Ends(const Sample& sample, bool of_a) const {
    std::array<End, 3> ends;
    for (int i = 0; i < 3; ++i) {
      const PointMatch& match = evidence_.matches()[sample[i]];
      ends[i] = of_a ? End{&a_.points[match.a], match.keyframe_a}
                     : End{&b_.points[match.b], match.keyframe_b};
    }
    return ends;
  }

  bool IsBelievable(double scale) const {
    return scale > 1.0 / options_.max_scale && scale < options_.max_scale;
  }

  std::vector<Similarity3> SolveTriangles(const Sample& sample) const {
    ThreePoints points_a, points_b;
    const auto ends_a = Ends(sample, true), ends_b = Ends(sample, false);
    for (int i = 0; i < 3; ++i) {
      if (!ends_a[i].point->landmark || !ends_b[i].point->landmark) return {};
      points_a.col(i) = ends_a[i].point->landmark->point_in_submap;
      points_b.col(i) = ends_b[i].point->landmark->point_in_submap;
    }
    const auto a_from_b = AlignThreePoints(points_a, points_b, options_.fixed_scale);
    if (!a_from_b || !IsBelievable(a_from_b->scale)) return {};
    return {*a_from_b};
  }

  // The pose of a camera of `seeing` from three landmarks of the other (`seen`): seen_from_seeing.
  std::vector<Similarity3> SolvePose(const std::array<End, 3>& seen, const SubmapPoints& seeing,
                                     const std::array<End, 3>& sights) const {
    ThreePoints points, bearings;
    const int keyframe = sights[0].keyframe;
    for (int i = 0; i < 3; ++i) {
      const PointView* view = ViewIn(*sights[i].point, keyframe);
      if (!seen[i].point->landmark || !view || !view->bearing) return {};
      points.col(i) = seen[i].point->landmark->point_in_submap;
      bearings.col(i) = *view->bearing;
    }
    const Rigid3& camera_from_seeing = seeing.camera_from_submap[keyframe];
    std::vector<Similarity3> hypotheses;
    for (const Rigid3& seen_from_camera : SolveThreePointPose(points, bearings)) {
      const auto scale = ScaleOf(seen, seen_from_camera, sights, camera_from_seeing);
      if (!scale || !IsBelievable(*scale)) continue;
      hypotheses.push_back(Similarity3::FromRigid(seen_from_camera, *scale) *
                           Similarity3::FromRigid(camera_from_seeing));
    }
    return hypotheses;
  }

  // Length of seeing's unit in seen's: weighted mean of the logarithms of the depths' ratios.
  std::optional<double> ScaleOf(const std::array<End, 3>& seen, const Rigid3& seen_from_camera,
                                const std::array<End, 3>& sights,
                                const Rigid3& camera_from_seeing) const {
    if (options_.fixed_scale) return 1.0;
    const Rigid3 camera_from_seen = seen_from_camera.Inverse();
    double sum = 0, weights = 0;
    for (int i = 0; i < 3; ++i) {
      const RefinedLandmark* landmark = sights[i].point->landmark;
      if (landmark == nullptr) continue;
      const RefinedLandmark& other = *seen[i].point->landmark;
      const Eigen::Vector3d point = camera_from_seeing * landmark->point_in_submap;
      const Eigen::Vector3d other_point = camera_from_seen * other.point_in_submap;
      if (!(point.squaredNorm() > 0) || !(other_point.squaredNorm() > 0)) continue;
      const double weight = 1.0 / (1.0 / LogDepthWeight(*landmark, point, camera_from_seeing) +
                                   1.0 / LogDepthWeight(other, other_point, camera_from_seen));
      sum += weight * std::log(other_point.norm() / point.norm());
      weights += weight;
    }
    if (!(weights > 0)) return std::nullopt;
    return std::exp(sum / weights);
  }

  const SubmapPoints& a_;
  const SubmapPoints& b_;
  const PairEvidence& evidence_;
  const SimilarityRansacOptions& options_;
  std::mt19937 random_;
};

std::vector<size_t> InliersOf(const std::vector<double>& evidence) {
  std::vector<size_t> inliers;
  for (size_t i = 0; i < evidence.size(); ++i) {
    if (evidence[i] > 0) inliers.push_back(i);
  }
  return inliers;
}

// Replaces the hypothesis while its local optimum is better. Returns the number of inliers.
size_t Polish(const PairEvidence& evidence, const LocalOptimiser& optimise,
              SimilarityHypothesis* hypothesis) {
  std::vector<size_t> inliers = InliersOf(evidence.EvidenceOfEach(hypothesis->a_from_b));
  for (int round = 0; round < 3 && inliers.size() >= 5; ++round) {
    const auto optimised = optimise(hypothesis->a_from_b, inliers);
    if (!optimised) break;
    const double total = evidence.TotalEvidence(*optimised, hypothesis->evidence);
    if (total <= hypothesis->evidence) break;
    *hypothesis = {*optimised, total};
    inliers = InliersOf(evidence.EvidenceOfEach(hypothesis->a_from_b));
  }
  return inliers.size();
}

// Samples needed so that one without outliers is missed with the given probability.
double NeededIterations(double inlier_share, double max_miss_probability) {
  const double hit = std::pow(inlier_share, 3);
  return hit >= 1.0 ? 1.0 : std::log(max_miss_probability) / std::log1p(-hit);
}

}  // namespace

std::optional<SimilarityHypothesis> FindSimilarity(const SubmapPoints& a, const SubmapPoints& b,
                                                   const PairEvidence& evidence,
                                                   const LocalOptimiser& optimise,
                                                   const SimilarityRansacOptions& options) {
  const size_t count = evidence.matches().size();
  if (count < 4) return std::nullopt;
  Sampler sampler(a, b, evidence, options);
  std::optional<SimilarityHypothesis> best;
  double needed = options.max_iterations;
  for (int iteration = 0; iteration < options.max_iterations && iteration < needed; ++iteration) {
    const Sample sample = sampler.Draw(iteration);
    // Which kind serves depends on the depths: each sample is solved as 3D-3D and as 3D-2D, the
    // latter with the roles taking turns.
    for (const int kind : {2, iteration % 2}) {
      for (const Similarity3& a_from_b : sampler.Solve(sample, kind)) {
        const double total = evidence.TotalEvidence(a_from_b, best ? best->evidence : 0.0);
        if (total <= (best ? best->evidence : 0.0)) continue;
        best = SimilarityHypothesis{a_from_b, total};
        const size_t inliers = Polish(evidence, optimise, &*best);
        needed =
            NeededIterations(static_cast<double>(inliers) / count, options.max_miss_probability);
      }
    }
  }
  return best;
}

}  // namespace portolan
