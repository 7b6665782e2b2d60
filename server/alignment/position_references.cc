#include "server/alignment/position_references.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <tuple>
#include <utility>

#include "common/base/concat.h"
#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

using PassSights = std::vector<SurveyedPoint::Sight>;

// How many fixes lie in a span of that length about the time, that of the time included.
double FixesAround(const std::vector<GnssFix>& fixes, Timestamp time, Duration span) {
  const auto first =
      std::lower_bound(fixes.begin(), fixes.end(), time - span / 2,
                       [](const GnssFix& fix, Timestamp at) { return fix.time < at; });
  const auto end = std::upper_bound(fixes.begin(), fixes.end(), time + span / 2,
                                    [](Timestamp at, const GnssFix& fix) { return at < fix.time; });
  return static_cast<double>(end - first);
}

// Fixes of one submap, each placed on the way between its neighbouring keyframes.
void AddFixes(const PositionReferenceOptions& options, const ModelSubmap& submap,
              const SiteOrigin& origin, double metres_per_unit, PositionReferences* references) {
  const Submap& raw = *submap.refined->raw;
  const std::vector<GnssFix>& fixes = raw.gnss;
  for (size_t i = 0; i < fixes.size(); ++i) {
    const auto in_site = PositionInSite(origin, fixes[i].position);
    if (!in_site.ok()) {
      ++references->unusable;
      references->unusable_reason =
          Concat("a position of agent ", raw.key.agent.value(), " ", in_site.status().message());
      continue;
    }
    const auto next = std::upper_bound(
        raw.keyframes.begin(), raw.keyframes.end(), fixes[i].time,
        [](Timestamp time, const Keyframe& keyframe) { return time < keyframe.time; });
    const int last = static_cast<int>(raw.keyframes.size()) - 1;
    const int after =
        std::clamp(static_cast<int>(next - raw.keyframes.begin()), std::min(1, last), last);
    const int before = std::max(after - 1, 0);
    double part = 0;
    if (after > before) {
      const Timestamp start = raw.keyframes[before].time;
      part = std::clamp(
          ToSeconds(fixes[i].time - start) / ToSeconds(raw.keyframes[after].time - start), 0.0,
          1.0);
    }
    const Rigid3& a = submap.world_from_camera[before];
    const Rigid3& b = submap.world_from_camera[after];
    PositionTerm term;
    term.submap = submap.refined->id;
    term.keyframe = before + part;
    term.time = fixes[i].time;
    term.point.in_world =
        (1 - part) * a.translation + part * b.translation +
        a.rotation.slerp(part, b.rotation) * raw.antenna_in_camera_m / metres_per_unit;
    term.point.in_site = *in_site;
    term.point.share = 1.0 / FixesAround(fixes, fixes[i].time, options.fix_correlation);
    const double horizontal = std::pow(fixes[i].sigma_horizontal_m, 2);
    const double vertical = std::pow(fixes[i].sigma_vertical_m, 2);
    term.point.site_covariance =
        Eigen::Vector3d(horizontal, horizontal, vertical).asDiagonal().toDenseMatrix();
    references->terms.push_back(term);
  }
}

// The keyframes that the point's observations mean; each camera once.
PassSights FindSights(const MapModel& model, const std::vector<SubmapId>& submaps,
                      const ControlPoint& point) {
  PassSights sights;
  for (const ControlObservation& observation : point.observations) {
    for (const SubmapId id : submaps) {
      const ModelSubmap& submap = model.submap(id);
      const Submap& raw = *submap.refined->raw;
      if (raw.key.agent != observation.agent || submap.quarantined()) continue;
      if (observation.session && raw.key.session != *observation.session) continue;
      const int keyframe = KeyframeAt(raw, observation.time);
      if (keyframe < 0) continue;
      const auto [camera, number] = model.CameraOf(id, keyframe);
      sights.push_back({camera, number, observation.pixel, observation.sigma_px});
      break;
    }
  }
  const auto name = [&model](const SurveyedPoint::Sight& sight) {
    const SubmapKey& key = model.submap(sight.submap).refined->raw->key;
    return std::tuple(key, sight.keyframe);
  };
  std::stable_sort(sights.begin(), sights.end(),
                   [&](const auto& a, const auto& b) { return name(a) < name(b); });
  sights.erase(std::unique(sights.begin(), sights.end(),
                           [&](const auto& a, const auto& b) { return name(a) == name(b); }),
               sights.end());
  return sights;
}

// Sights in submaps that follow each other.
std::vector<PassSights> SplitIntoPasses(const MapModel& model, const PassSights& sights) {
  std::vector<PassSights> passes;
  const SubmapKey* last = nullptr;
  for (const SurveyedPoint::Sight& sight : sights) {
    const SubmapKey& key = model.submap(sight.submap).refined->raw->key;
    const bool follows = last != nullptr && last->agent == key.agent &&
                         last->session == key.session &&
                         key.sequence_number <= last->sequence_number + 1;
    if (!follows) passes.emplace_back();
    passes.back().push_back(sight);
    last = &key;
  }
  return passes;
}

// The point as the sights of a pass have it; its covariance is that of the rays.
std::optional<PositionTerm> TermOfPass(const PositionReferenceOptions& options,
                                       const MapModel& model, const PassSights& pass) {
  if (pass.size() < 2) return std::nullopt;
  std::vector<TrackSight> sights;
  for (const SurveyedPoint::Sight& sight : pass) {
    const ModelSubmap& submap = model.submap(sight.submap);
    sights.push_back({{submap.world_from_camera[sight.keyframe], submap.camera.get()},
                      sight.pixel,
                      sight.sigma_px});
  }
  // The distance that is believed without parallax; such passes are left out below.
  double extent = 0;
  for (const TrackSight& sight : sights) {
    extent = std::max(extent, (sight.camera.world_from_camera.translation -
                               sights.front().camera.world_from_camera.translation)
                                  .norm());
  }
  if (!(extent > 0)) return std::nullopt;
  const auto triangulated =
      TriangulateTrack(options.triangulation, sights, std::nullopt, 10 * extent);
  if (!triangulated) return std::nullopt;
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  std::vector<Eigen::Vector3d> cameras;
  for (size_t i = 0; i < sights.size(); ++i) {
    if (!triangulated->inliers[i]) continue;
    const Rigid3& pose = sights[i].camera.world_from_camera;
    cameras.push_back(pose.translation);
    const Eigen::Matrix3d camera_from_world = pose.rotation.conjugate().toRotationMatrix();
    Matrix23d jacobian;
    if (!sights[i].camera.model->Project(
            camera_from_world * (triangulated->point_in_world - pose.translation), &jacobian)) {
      continue;
    }
    jacobian = (jacobian * camera_from_world / sights[i].sigma_px).eval();
    information += jacobian.transpose() * jacobian;
  }
  if (ParallaxRad(cameras, triangulated->point_in_world) < options.min_pass_parallax_rad) {
    return std::nullopt;
  }
  const SurveyedPoint::Sight& middle = pass[pass.size() / 2];
  PositionTerm term;
  term.submap = middle.submap;
  term.keyframe = middle.keyframe;
  term.time = model.submap(middle.submap).refined->raw->keyframes[middle.keyframe].time;
  term.point.in_world = triangulated->point_in_world;
  term.point.world_covariance = InverseOfPositiveDefinite(information);
  if (!term.point.world_covariance.allFinite()) return std::nullopt;
  return term;
}

void AddControlPoint(const PositionReferenceOptions& options, const MapModel& model,
                     const PassSights& sights, const ControlPoint& point, int index,
                     const Eigen::Vector3d& in_site, PositionReferences* references) {
  std::vector<PositionTerm> terms;
  for (const PassSights& pass : SplitIntoPasses(model, sights)) {
    if (auto term = TermOfPass(options, model, pass)) terms.push_back(*std::move(term));
  }
  if (terms.empty()) {
    if (auto term = TermOfPass(options, model, sights)) terms.push_back(*std::move(term));
  }
  if (terms.empty()) {
    ++references->unusable;
    references->unusable_reason =
        Concat("control point ", point.id, ": the rays of its ", sights.size(),
               " observations do not meet at a useful angle");
    return;
  }
  const double variance = std::pow(point.sigma_m, 2);
  for (PositionTerm& term : terms) {
    term.control_point = index;
    term.point.in_site = in_site;
    term.point.site_covariance = variance * Eigen::Matrix3d::Identity();
    // All passes have the survey's error in common.
    term.point.share = 1.0 / static_cast<double>(terms.size());
    references->terms.push_back(term);
  }
  references->points.push_back({index, in_site, point.sigma_m, sights});
}

}  // namespace

Status PositionReferenceOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(triangulation.Validate());
  if (fix_correlation < Duration::zero() || !(min_pass_parallax_rad >= 0)) {
    return absl::InvalidArgumentError("position references: limits out of range");
  }
  return absl::OkStatus();
}

int KeyframeAt(const Submap& submap, Timestamp time) {
  const auto next = std::lower_bound(
      submap.keyframes.begin(), submap.keyframes.end(), time - kKeyframeTimeTolerance,
      [](const Keyframe& keyframe, Timestamp at) { return keyframe.time < at; });
  if (next == submap.keyframes.end() || next->time > time + kKeyframeTimeTolerance) return -1;
  return static_cast<int>(next - submap.keyframes.begin());
}

PositionReferences CollectPositionReferences(const PositionReferenceOptions& options,
                                             const MapModel& model,
                                             const std::vector<SubmapId>& submaps,
                                             const Survey& survey, const SiteOrigin& origin,
                                             double metres_per_unit) {
  PositionReferences references;
  for (const SubmapId id : submaps) {
    const ModelSubmap& submap = model.submap(id);
    if (!submap.quarantined()) AddFixes(options, submap, origin, metres_per_unit, &references);
  }
  for (size_t i = 0; i < survey.points.size(); ++i) {
    const ControlPoint& point = survey.points[i];
    const PassSights sights = FindSights(model, submaps, point);
    if (sights.empty()) continue;
    const auto in_site = PositionInSite(origin, point);
    if (!in_site.ok()) {
      ++references.unusable;
      references.unusable_reason =
          Concat("control point ", point.id, " ", in_site.status().message());
      continue;
    }
    AddControlPoint(options, model, sights, point, static_cast<int>(i), *in_site, &references);
  }
  return references;
}

}  // namespace portolan
