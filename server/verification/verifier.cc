#include "server/verification/verifier.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <tuple>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/linear_algebra/dense.h"
#include "server/verification/similarity_refinement.h"

namespace portolan {
namespace {

constexpr int kGridColumns = 8, kGridRows = 6;

Status CheckRange(const char* name, double value, double low, double high) {
  if (value >= low && value <= high) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("verifier: ", name, " = ", value, " is not in [", low, ", ", high, "]"));
}

std::vector<PointMatch> Select(const std::vector<PointMatch>& matches,
                               const std::vector<size_t>& indices) {
  std::vector<PointMatch> selected;
  for (const size_t i : indices) selected.push_back(matches[i]);
  return selected;
}

int CellOf(const Eigen::Vector2d& pixel, const CameraModel& camera) {
  const int column = static_cast<int>(pixel.x() * kGridColumns / camera.width_px());
  const int row = static_cast<int>(pixel.y() * kGridRows / camera.height_px());
  return std::clamp(row, 0, kGridRows - 1) * kGridColumns + std::clamp(column, 0, kGridColumns - 1);
}

// Cells that the matched points occupy in the keyframe where they occupy most.
int OccupiedCells(const SubmapPoints& submap, const std::vector<int>& points) {
  const CameraModel& camera = *submap.submap->camera;
  size_t most = 0;
  for (const DescribedKeyframe& keyframe : submap.keyframes) {
    std::set<int> cells;
    for (const int point : points) {
      const PointView* view = ViewIn(submap.points[point], keyframe.keyframe);
      if (view != nullptr) cells.insert(CellOf(view->pixel, camera));
    }
    most = std::max(most, cells.size());
  }
  return static_cast<int>(most);
}

// One verification, step by step; each step returns false and a reason if the pair is refused.
class Verification {
 public:
  Verification(const VerifierOptions& options, const SubmapPoints& a, const SubmapPoints& b,
               VerificationReport* report)
      : options_(options), a_(a), b_(b), report_(report) {
    ransac_options_ = options.ransac;
    refinement_options_.sigma_px = options.evidence.sigma_px;
  }

  bool Run() {
    return FindHypothesis() && Refine() && CheckInliers() && CheckConditioning() && CheckScale() &&
           CheckGravity() && CheckRivals();
  }

  Closure MakeClosure() const {
    Closure closure;
    closure.a = a_.submap->id;
    closure.b = b_.submap->id;
    closure.a_from_b = refined_.a_from_b;
    closure.information = information_;
    double squares = 0;
    for (size_t i = 0; i < inliers_.size(); ++i) {
      squares += refined_.error_px[i] * refined_.error_px[i];
      const SubmapPoint& point_a = a_.points[inliers_[i].a];
      const SubmapPoint& point_b = b_.points[inliers_[i].b];
      if (point_a.landmark == nullptr || point_b.landmark == nullptr) continue;
      closure.matches.push_back({point_a.landmark->track, point_b.landmark->track});
    }
    std::sort(closure.matches.begin(), closure.matches.end(),
              [](const LandmarkMatch& x, const LandmarkMatch& y) { return x.in_a < y.in_a; });
    closure.rms_px = std::sqrt(squares / static_cast<double>(inliers_.size()));
    return closure;
  }

 private:
  bool Refuse(const char* reason) {
    report_->refusal = reason;
    return false;
  }

  bool FindHypothesis() {
    matches_ = MatchDescriptors(a_, b_, options_.matcher);
    report_->putative_matches = static_cast<int>(matches_.putative.size());
    const PairEvidence evidence(a_, b_, matches_.putative, options_.evidence);
    SimilarityRefinementOptions quick = refinement_options_;
    quick.max_views = 1;
    quick.max_iterations = 3;
    const auto optimise = [&](const Similarity3& a_from_b, const std::vector<size_t>& inliers) {
      const auto refined =
          RefineSimilarity(a_, b_, Select(evidence.matches(), inliers), a_from_b, quick);
      return refined ? std::optional<Similarity3>(refined->a_from_b) : std::nullopt;
    };
    const auto hypothesis = FindSimilarity(a_, b_, evidence, optimise, ransac_options_);
    if (!hypothesis) return Refuse("too few matches");
    report_->evidence = hypothesis->evidence;
    for (const double e : evidence.EvidenceOfEach(hypothesis->a_from_b)) {
      report_->ransac_inliers += e > 0;
    }
    a_from_b_ = hypothesis->a_from_b;
    return hypothesis->evidence >= options_.min_evidence || Refuse("too little evidence");
  }

  // Guided matching and refinement, twice: the second search starts from the first's result and
  // looks less far, because most wrong matches lie at the rim of the search regions.
  bool Refine() {
    for (int round = 0; round < 2; ++round) {
      GuidedMatcherOptions search = options_.guided;
      search.relation_sigma_px /= 1 << round;
      const GuidedMatches guided = MatchGuided(a_, b_, a_from_b_, search);
      const auto rough = RefineSimilarity(a_, b_, guided.matches, a_from_b_, refinement_options_);
      if (!rough) return Refuse("refinement failed");
      inliers_.clear();
      for (size_t i = 0; i < guided.matches.size(); ++i) {
        if (rough->chi_squared[i] < options_.evidence.max_chi_squared) {
          inliers_.push_back(guided.matches[i]);
        }
      }
      a_from_b_ = rough->a_from_b;
      report_->inlier_share =
          inliers_.size() / std::max(1.0, static_cast<double>(guided.matches.size()));
      report_->visible_share = inliers_.size() / std::max(1.0, 0.5 * guided.predicted);
      if (round == 1) report_->evenness = Evenness(guided);
    }
    const auto refined = RefineSimilarity(a_, b_, inliers_, a_from_b_, refinement_options_);
    if (!refined) return Refuse("refinement failed");
    refined_ = *refined;
    a_from_b_ = refined_.a_from_b;
    CountSupport();
    const double scale = a_from_b_.scale;
    const bool believable =
        scale < ransac_options_.max_scale && scale * ransac_options_.max_scale > 1;
    return believable || Refuse("implausible scale");
  }

  // See VerifierOptions::min_evenness.
  double Evenness(const GuidedMatches& guided) const {
    std::vector<bool> found_a(a_.points.size()), found_b(b_.points.size());
    for (const PointMatch& match : inliers_) found_a[match.a] = found_b[match.b] = true;
    struct Cell {
      int predicted = 0, found = 0;
    };
    std::map<std::tuple<bool, int, int>, Cell> cells;  // whose landmarks, keyframe, cell
    double found = 0;
    for (const PredictedSight& sight : guided.sights) {
      const SubmapPoints& seen_by = sight.of_a ? b_ : a_;
      Cell& cell =
          cells[{sight.of_a, sight.keyframe, CellOf(sight.pixel, *seen_by.submap->camera)}];
      const bool is_found = (sight.of_a ? found_a : found_b)[sight.point];
      ++cell.predicted;
      cell.found += is_found;
      found += is_found;
    }
    if (found == 0) return 0;
    const double missed = 1 - found / static_cast<double>(guided.sights.size());
    double expected = 0, occupied = 0;
    for (const auto& [key, cell] : cells) {
      expected += 1 - std::pow(missed, cell.predicted);
      occupied += cell.found > 0;
    }
    return occupied / expected;
  }

  // Evidence of the putative matches, which were found without the result, for it.
  void CountSupport() {
    const PairEvidence evidence(a_, b_, matches_.putative, options_.evidence);
    report_->evidence = 0;
    report_->ransac_inliers = 0;
    for (const double e : evidence.EvidenceOfEach(a_from_b_)) {
      report_->evidence += e;
      report_->ransac_inliers += e > 0;
    }
  }

  bool CheckInliers() {
    std::vector<int> points_a, points_b;
    for (const PointMatch& match : inliers_) {
      points_a.push_back(match.a);
      points_b.push_back(match.b);
      report_->landmark_matches += a_.points[match.a].landmark && b_.points[match.b].landmark;
    }
    report_->inliers = static_cast<int>(inliers_.size());
    report_->cells = std::min(OccupiedCells(a_, points_a), OccupiedCells(b_, points_b));
    if (report_->inliers < options_.min_inliers ||
        report_->landmark_matches < options_.min_landmark_matches) {
      return Refuse("too few inliers");
    }
    if (report_->inlier_share < options_.min_inlier_share ||
        report_->visible_share < options_.min_visible_share) {
      return Refuse("too many outliers");
    }
    if (report_->visible_share < options_.max_share_to_ask_evenness &&
        report_->evenness < options_.min_evenness) {
      return Refuse("matches in one part of the view only");
    }
    return report_->cells >= options_.min_cells || Refuse("matches not spread");
  }

  bool CheckConditioning() {
    // Errors larger than assumed widen the covariance; smaller ones do not shrink it.
    double mean = 0;
    for (const double chi_squared : refined_.chi_squared) {
      mean += 0.5 * chi_squared / static_cast<double>(refined_.chi_squared.size());
    }
    information_ = refined_.information / std::max(1.0, mean);
    Matrix7d covariance = Matrix7d::Identity();
    if (!SolvePositiveDefinite(information_, covariance)) return Refuse("ill-conditioned");
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> translation(
        covariance.topLeftCorner<3, 3>(), Eigen::EigenvaluesOnly);
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> rotation(covariance.block<3, 3>(3, 3),
                                                                  Eigen::EigenvaluesOnly);
    report_->relative_translation_sigma =
        std::sqrt(translation.eigenvalues().maxCoeff()) / MedianDistanceInB();
    report_->rotation_sigma_rad = std::sqrt(rotation.eigenvalues().maxCoeff());
    report_->log_scale_sigma = std::sqrt(covariance(6, 6));
    // Written so that NaN refuses.
    const bool good =
        report_->relative_translation_sigma < options_.max_relative_translation_sigma &&
        report_->rotation_sigma_rad < options_.max_rotation_sigma_rad &&
        report_->log_scale_sigma < options_.max_log_scale_sigma;
    return good || Refuse("ill-conditioned");
  }

  double MedianDistanceInB() const {
    std::vector<double> distances;
    for (const PointMatch& match : inliers_) {
      const RefinedLandmark* landmark = b_.points[match.b].landmark;
      if (landmark == nullptr) continue;
      const Rigid3& camera_from_b = b_.camera_from_submap[match.keyframe_b];
      distances.push_back((camera_from_b * landmark->point_in_submap).norm());
    }
    if (distances.empty()) return 0;
    std::nth_element(distances.begin(), distances.begin() + distances.size() / 2, distances.end());
    return distances[distances.size() / 2];
  }

  bool CheckScale() {
    if (!a_.submap->raw->metric || !b_.submap->raw->metric) return true;
    return std::abs(std::log(refined_.a_from_b.scale)) < options_.max_metric_log_scale ||
           Refuse("metric scales disagree");
  }

  bool CheckGravity() {
    const auto& in_a = a_.submap->raw->gravity_in_submap;
    const auto& in_b = b_.submap->raw->gravity_in_submap;
    if (!in_a || !in_b) return true;
    const Eigen::Vector3d turned = refined_.a_from_b.rotation * *in_b;
    const double angle = std::atan2(turned.cross(*in_a).norm(), turned.dot(*in_a));
    return angle < options_.max_gravity_error_rad || Refuse("gravity disagrees");
  }

  bool CheckRivals() {
    report_->rival_share = BestRivalShare(a_, b_, matches_, refined_.a_from_b, options_.evidence,
                                          ransac_options_, options_.rivals);
    return report_->rival_share < options_.max_rival_share || Refuse("ambiguous");
  }

  const VerifierOptions& options_;
  const SubmapPoints& a_;
  const SubmapPoints& b_;
  VerificationReport* const report_;
  SimilarityRansacOptions ransac_options_;
  SimilarityRefinementOptions refinement_options_;
  DescriptorMatches matches_;
  Similarity3 a_from_b_;
  std::vector<PointMatch> inliers_;
  RefinedSimilarity refined_;
  Matrix7d information_ = Matrix7d::Zero();
};

}  // namespace

Status VerifierOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(CheckRange("max_features", max_features, 1, 100000));
  PORTOLAN_RETURN_IF_ERROR(
      CheckRange("matcher.max_distance_bits", matcher.max_distance_bits, 0, 256));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("matcher.max_ratio", matcher.max_ratio, 0, 1));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("matcher.max_alternatives", matcher.max_alternatives, 1, 16));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("evidence.sigma_px", evidence.sigma_px, 0.05, 50));
  PORTOLAN_RETURN_IF_ERROR(
      CheckRange("evidence.max_chi_squared", evidence.max_chi_squared, 1, 100));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("ransac.max_iterations", ransac.max_iterations, 1, 100000));
  PORTOLAN_RETURN_IF_ERROR(
      CheckRange("ransac.max_miss_probability", ransac.max_miss_probability, 1e-12, 0.5));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("ransac.max_scale", ransac.max_scale, 1, 1e6));
  PORTOLAN_RETURN_IF_ERROR(
      CheckRange("guided.max_distance_bits", guided.max_distance_bits, 0, 256));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("guided.max_radius_px", guided.max_radius_px, 1, 1000));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("rivals.max_shifts", rivals.max_shifts, 0, 10000));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("min_inliers", min_inliers, 6, 10000));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("min_landmark_matches", min_landmark_matches, 4, 10000));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("min_evidence", min_evidence, 0, 1e6));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("min_inlier_share", min_inlier_share, 0, 1));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("min_visible_share", min_visible_share, 0, 1));
  PORTOLAN_RETURN_IF_ERROR(CheckRange("min_evenness", min_evenness, 0, 1));
  PORTOLAN_RETURN_IF_ERROR(
      CheckRange("max_share_to_ask_evenness", max_share_to_ask_evenness, 0, 1));
  return CheckRange("max_rival_share", max_rival_share, 0, 1);
}

StatusOr<Verifier> Verifier::Create(const VerifierOptions& options) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  return Verifier(options);
}

std::optional<SubmapPoints> Verifier::PointsOf(const RefinedSubmap& submap) const {
  return MakeSubmapPoints(submap, options_.max_features);
}

std::optional<Closure> Verifier::Verify(const RefinedSubmap& a, const RefinedSubmap& b,
                                        VerificationReport* report) const {
  return Verify(PointsOf(a), PointsOf(b), report);
}

std::optional<Closure> Verifier::Verify(const std::optional<SubmapPoints>& a,
                                        const std::optional<SubmapPoints>& b,
                                        VerificationReport* report) const {
  VerificationReport unused;
  if (report == nullptr) report = &unused;
  *report = VerificationReport();
  if (!a || !b) {
    report->refusal = "nothing to match";
    return std::nullopt;
  }
  Verification verification(options_, *a, *b, report);
  if (!verification.Run()) return std::nullopt;
  return verification.MakeClosure();
}

}  // namespace portolan
