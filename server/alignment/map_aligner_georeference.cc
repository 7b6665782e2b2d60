// The map aligner's use of known positions: control points and satellite fixes put a component into
// the site's frame and bend it to where they say it is.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "server/alignment/map_aligner.h"

namespace portolan {
namespace {

// Mean squared error of the positions, in sigmas and each cut off, above which a component bends
// too far for a bundle adjustment alone; 3 are expected.
constexpr double kMaxMeanChi2 = 6.0;
constexpr double kCutOffChi2 = 50.0;
// A component in the site's frame moves as a whole if that lowers the mean by this much.
constexpr double kMinChi2Gain = 0.1;
constexpr double kOutlierChi2 = 25.0;

std::vector<SitePoint> PointsOf(const PositionReferences& references) {
  std::vector<SitePoint> points;
  for (const PositionTerm& term : references.terms) points.push_back(term.point);
  return points;
}

double MeanChi2(const PositionReferences& references, const Similarity3& site_from_world) {
  double sum = 0;
  const std::vector<double> chi2 = SiteChi2(PointsOf(references), site_from_world);
  for (const double one : chi2) sum += std::min(one, kCutOffChi2);
  return chi2.empty() ? 0 : sum / static_cast<double>(chi2.size());
}

// Root mean squares of the residuals, control points and fixes apart.
class ResidualSums {
 public:
  void Add(const GeoreferenceResidual& residual) {
    ++count_;
    horizontal_ += residual.error_m.head<2>().squaredNorm();
    vertical_ += residual.error_m.z() * residual.error_m.z();
  }
  double Horizontal() const { return count_ == 0 ? 0 : std::sqrt(horizontal_ / count_); }
  double Vertical() const { return count_ == 0 ? 0 : std::sqrt(vertical_ / count_); }

 private:
  int count_ = 0;
  double horizontal_ = 0;
  double vertical_ = 0;
};

}  // namespace

void MapAligner::SetSurvey(std::shared_ptr<const Survey> survey) {
  relaxing_.reset();
  std::set<AgentId> agents;
  for (const Survey* one : {survey_.get(), survey.get()}) {
    for (const ControlPoint& point : one->points) {
      for (const ControlObservation& sight : point.observations) agents.insert(sight.agent);
    }
  }
  const bool has_new_origin = ImpliedOrigin(*survey) != ImpliedOrigin(*survey_);
  survey_ = std::move(survey);
  for (const auto& [id, submap] : model_.submaps()) {
    const Submap& raw = *submap.refined->raw;
    if (submap.quarantined()) continue;
    if (!agents.contains(raw.key.agent) && !(has_new_origin && !raw.gnss.empty())) continue;
    if (IsLarge(submap.component)) {
      strained_.insert(submap.component);
    } else {
      MarkStale(id, 2);
    }
  }
}

void MapAligner::RestoreGeoreference(ComponentId component, const SiteOrigin& origin) {
  GeoreferenceReport report;
  report.is_georeferenced = true;
  report.origin = origin;
  site_ = origin;
  georeferences_[component] = std::make_shared<const GeoreferenceReport>(std::move(report));
}

bool MapAligner::IsGeoreferenced(ComponentId component) const {
  const auto known = georeferences_.find(component);
  return known != georeferences_.end() && known->second->is_georeferenced;
}

void MapAligner::ReportProblem(ComponentId component, std::string problem) {
  GeoreferenceReport report;
  report.problem = std::move(problem);
  if (site_) report.origin = *site_;
  georeferences_[component] = std::make_shared<const GeoreferenceReport>(std::move(report));
}

// An origin that nobody named stays as it was first chosen.
void MapAligner::ChooseSite() {
  std::optional<SiteOrigin> chosen = ImpliedOrigin(*survey_);
  const bool is_binding = survey_->origin || (chosen && !chosen->geodetic);
  if (!is_binding && site_ && site_->geodetic) return;
  if (!chosen) {
    for (const auto& [id, submap] : model_.submaps()) {
      if (submap.quarantined() || submap.refined->raw->gnss.empty()) continue;
      chosen = SiteOrigin{submap.refined->raw->gnss.front().position, Eigen::Vector3d::Zero()};
      break;
    }
  }
  if (chosen == site_) return;
  site_ = chosen;
  georeferences_.clear();
}

bool MapAligner::Georeference(ComponentId component, PositionReferences* references) {
  if (!has_fixes_ && survey_->points.empty()) {
    georeferences_.erase(component);
    return false;
  }
  ChooseSite();
  if (!site_) return false;
  const bool was_there = IsGeoreferenced(component);
  if (!was_there) MakeMetric(component);
  const std::vector<SubmapId> ids = model_.SubmapsOf(component);
  const auto has = [&](auto predicate) {
    return std::any_of(ids.begin(), ids.end(), [&](SubmapId id) {
      return !model_.submap(id).quarantined() && predicate(*model_.submap(id).refined->raw);
    });
  };
  const bool is_metric = has([](const Submap& raw) { return raw.metric; });
  const bool is_vertical = has([](const Submap& raw) { return raw.gravity_in_submap.has_value(); });
  const auto collect = [&](double metres_per_unit) {
    *references = CollectPositionReferences(options_.positions, model_, ids, *survey_, *site_,
                                            metres_per_unit);
    return FitGeoreference(options_.relaxation.positions, PointsOf(*references), is_metric,
                           is_vertical);
  };
  // Where nothing tells metres, the lever arms wait for the first fit.
  const bool has_metres = was_there || is_metric;
  GeoreferenceFit fit = collect(has_metres ? 1 : std::numeric_limits<double>::infinity());
  if (references->terms.empty() && references->unusable == 0) {
    georeferences_.erase(component);
    return false;
  }
  if (!has_metres && fit.problem.empty()) fit = collect(fit.site_from_world.scale);
  if (!fit.problem.empty()) {
    ReportProblem(component, references->terms.empty() ? references->unusable_reason : fit.problem);
    return false;
  }
  if (!was_there || MeanChi2(*references, fit.site_from_world) + kMinChi2Gain <
                        MeanChi2(*references, Similarity3::Identity())) {
    model_.MoveComponent(component, component, fit.site_from_world);
    moved_.insert(ids.begin(), ids.end());
    collect(1);
  }
  GeoreferenceReport report;
  report.is_georeferenced = true;
  report.mode = fit.mode;
  georeferences_[component] = std::make_shared<const GeoreferenceReport>(std::move(report));
  ReportErrors(component);
  return true;
}

bool MapAligner::BendToPositions(ComponentId component, const std::atomic<bool>& interrupt,
                                 PositionReferences* references) {
  if (MeanChi2(*references, Similarity3::Identity()) < kMaxMeanChi2) return true;
  const std::vector<SubmapId> ids = model_.SubmapsOf(component);
  MapRelaxationOptions relaxation = options_.relaxation;
  relaxation.max_iterations = options_.bending_iterations;
  const RelaxationSummary summary = RelaxSubmaps(relaxation, options_.adjuster.metric, ids,
                                                 &interrupt, &model_, &references->terms);
  if (summary.iterations > 0) moved_.insert(ids.begin(), ids.end());
  *references = CollectPositionReferences(options_.positions, model_, ids, *survey_, *site_, 1.0);
  return !summary.interrupted;
}

void MapAligner::ReportErrors(ComponentId component) {
  GeoreferenceReport report;
  if (const auto known = georeferences_.find(component); known != georeferences_.end()) {
    report.is_georeferenced = known->second->is_georeferenced;
    report.mode = known->second->mode;
    report.origin = known->second->origin;
    report.problem = known->second->problem;
  }
  double log_scales = 0, tilts = 0;
  for (const SubmapId id : model_.SubmapsOf(component)) {
    const ModelSubmap& submap = model_.submap(id);
    const auto& gravity = submap.refined->raw->gravity_in_submap;
    if (submap.quarantined()) continue;
    if (const auto scale = MeasureScale(options_.adjuster.metric, model_, id)) {
      ++report.metric_submap_count;
      log_scales += scale->log_scale * scale->log_scale;
    }
    if (!gravity) continue;
    ++report.vertical_submap_count;
    const double cosine = -(submap.world_from_submap.rotation * *gravity).z();
    tilts += std::pow(std::acos(std::clamp(cosine, -1.0, 1.0)), 2);
  }
  report.rms_log_scale = std::sqrt(log_scales / std::max(report.metric_submap_count, 1));
  report.rms_tilt_rad = std::sqrt(tilts / std::max(report.vertical_submap_count, 1));
  if (report.is_georeferenced && site_) ReportPositions(component, &report);
  if (!report.is_georeferenced && report.problem.empty() && report.metric_submap_count == 0 &&
      report.vertical_submap_count == 0) {
    return;
  }
  georeferences_[component] = std::make_shared<const GeoreferenceReport>(std::move(report));
}

void MapAligner::ReportPositions(ComponentId component, GeoreferenceReport* report) const {
  const PositionReferences references = CollectPositionReferences(
      options_.positions, model_, model_.SubmapsOf(component), *survey_, *site_, 1.0);
  report->origin = *site_;
  report->problem = references.unusable_reason;
  const std::vector<double> chi2 = SiteChi2(PointsOf(references), Similarity3::Identity());
  const double limit = std::max(kOutlierChi2, SiteLossSquare(options_.relaxation.positions, chi2));
  ResidualSums control, fixes;
  std::set<int> points;
  for (size_t i = 0; i < chi2.size(); ++i) {
    const PositionTerm& term = references.terms[i];
    GeoreferenceResidual residual;
    residual.agent = model_.submap(term.submap).refined->raw->key.agent;
    residual.time = term.time;
    residual.error_m = term.point.in_world - term.point.in_site;
    residual.sigma_m =
        std::sqrt(term.point.site_covariance.trace() + term.point.world_covariance.trace());
    residual.is_outlier = chi2[i] > limit;
    const bool is_control = term.control_point >= 0;
    if (is_control) {
      residual.control_point = survey_->points[term.control_point].id;
      points.insert(term.control_point);
    } else {
      ++report->fix_count;
    }
    report->outlier_count += residual.is_outlier ? 1 : 0;
    if (!residual.is_outlier) (is_control ? control : fixes).Add(residual);
    report->residuals.push_back(std::move(residual));
  }
  report->control_point_count = static_cast<int>(points.size());
  report->rms_control_horizontal_m = control.Horizontal();
  report->rms_control_vertical_m = control.Vertical();
  report->rms_fix_horizontal_m = fixes.Horizontal();
  report->rms_fix_vertical_m = fixes.Vertical();
  std::stable_partition(report->residuals.begin(), report->residuals.end(),
                        [](const auto& residual) { return !residual.control_point.empty(); });
  if (report->residuals.size() > kMaxReportedResiduals) {
    report->residuals.resize(kMaxReportedResiduals);
  }
}

}  // namespace portolan
