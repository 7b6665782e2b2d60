#include "server/evaluation/evaluation_report.h"

#include <cmath>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace portolan {
namespace {

constexpr double kDegreesPerRadian = 180.0 / M_PI;

std::string TableHeader() {
  return absl::StrFormat("%-20s %7s %7s %8s | %9s %9s %9s %9s | %9s %9s | %8s\n", "", "poses",
                         "matched", "coverage", "ATE rmse", "mean", "median", "max", "RPE /m",
                         "RPE /s", "scale") +
         absl::StrFormat("%-20s %7s %7s %8s | %9s %9s %9s %9s | %9s %9s | %8s\n", "", "", "", "",
                         "m", "m", "m", "m", "%", "m/s", "error %");
}

std::string TableRow(const AlignedErrors& errors) {
  return absl::StrFormat(
      "%-20s %7d %7d %8.3f | %9.4f %9.4f %9.4f %9.4f | %9.3f %9.4f | %8s\n", "  " + errors.name,
      errors.estimate_poses, errors.ate_m.count, errors.coverage, errors.ate_m.rmse,
      errors.ate_m.mean, errors.ate_m.median, errors.ate_m.max,
      100 * errors.rpe_per_m.translation.rmse, errors.rpe_per_s.translation.rmse,
      errors.scale_error ? absl::StrFormat("%+.3f", 100 * *errors.scale_error) : "-");
}

std::string Details(const AlignedErrors& errors) {
  std::string text = absl::StrFormat(
      "  reference path %.2f m; rotation error rmse %.3f deg, max %.3f deg; RPE rotation %.3f "
      "deg/m, %.3f deg/s\n",
      errors.reference_path_m, kDegreesPerRadian * errors.rotation_rad.rmse,
      kDegreesPerRadian * errors.rotation_rad.max,
      kDegreesPerRadian * errors.rpe_per_m.rotation_rad.rmse,
      kDegreesPerRadian * errors.rpe_per_s.rotation_rad.rmse);
  if (errors.kitti.segments > 0) {
    absl::StrAppendFormat(
        &text, "  KITTI segments of 100 to 800 m: %.3f %%, %.5f deg/m (%d segments)\n",
        errors.kitti.translation_percent, errors.kitti.rotation_deg_per_m, errors.kitti.segments);
  }
  return text;
}

std::string JsonString(const std::string& text) {
  std::string json = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      json += '\\';
      json += c;
    } else if (static_cast<unsigned char>(c) < 0x20) {
      absl::StrAppendFormat(&json, "\\u%04x", static_cast<int>(c));
    } else {
      json += c;
    }
  }
  return json + '"';
}

// JSON has no infinity and no NaN.
std::string JsonNumber(double value) {
  return std::isfinite(value) ? absl::StrFormat("%.9g", value) : "null";
}

std::string JsonObject(const std::vector<std::pair<std::string, std::string>>& members) {
  return absl::StrCat("{",
                      absl::StrJoin(members, ", ",
                                    [](std::string* out, const auto& member) {
                                      absl::StrAppend(out, JsonString(member.first), ": ",
                                                      member.second);
                                    }),
                      "}");
}

std::string JsonStatistics(const ErrorStatistics& statistics, double factor) {
  return JsonObject({{"count", absl::StrCat(statistics.count)},
                     {"rmse", JsonNumber(factor * statistics.rmse)},
                     {"mean", JsonNumber(factor * statistics.mean)},
                     {"median", JsonNumber(factor * statistics.median)},
                     {"std", JsonNumber(factor * statistics.standard_deviation)},
                     {"min", JsonNumber(factor * statistics.min)},
                     {"max", JsonNumber(factor * statistics.max)}});
}

std::string JsonTransform(const Similarity3& transform) {
  const Eigen::Vector3d& t = transform.translation;
  const Eigen::Quaterniond& q = transform.rotation;
  const auto list = [](std::initializer_list<double> numbers) {
    std::vector<std::string> texts;
    for (const double number : numbers) texts.push_back(JsonNumber(number));
    return absl::StrCat("[", absl::StrJoin(texts, ", "), "]");
  };
  return JsonObject({{"scale", JsonNumber(transform.scale)},
                     {"translation_m", list({t.x(), t.y(), t.z()})},
                     {"rotation_xyzw", list({q.x(), q.y(), q.z(), q.w()})}});
}

std::string JsonErrors(const AlignedErrors& errors) {
  const double degrees = kDegreesPerRadian;
  return JsonObject(
      {{"poses", absl::StrCat(errors.estimate_poses)},
       {"matched", absl::StrCat(errors.ate_m.count)},
       {"coverage", JsonNumber(errors.coverage)},
       {"reference_path_m", JsonNumber(errors.reference_path_m)},
       {"ate_m", JsonStatistics(errors.ate_m, 1)},
       {"rotation_deg", JsonStatistics(errors.rotation_rad, degrees)},
       {"rpe_translation_m_per_m", JsonStatistics(errors.rpe_per_m.translation, 1)},
       {"rpe_rotation_deg_per_m", JsonStatistics(errors.rpe_per_m.rotation_rad, degrees)},
       {"rpe_translation_m_per_s", JsonStatistics(errors.rpe_per_s.translation, 1)},
       {"rpe_rotation_deg_per_s", JsonStatistics(errors.rpe_per_s.rotation_rad, degrees)},
       {"kitti_segments", absl::StrCat(errors.kitti.segments)},
       {"kitti_translation_percent", JsonNumber(errors.kitti.translation_percent)},
       {"kitti_rotation_deg_per_m", JsonNumber(errors.kitti.rotation_deg_per_m)},
       {"scale_error", errors.scale_error ? JsonNumber(*errors.scale_error) : "null"},
       {"reference_from_estimate", JsonTransform(errors.reference_from_estimate)}});
}

std::vector<Eigen::Vector3d> Positions(const Trajectory& trajectory) {
  std::vector<Eigen::Vector3d> positions;
  for (const StampedPose& pose : trajectory) positions.push_back(pose.world_from_body.translation);
  return positions;
}

}  // namespace

std::string EvaluationText(const TrajectoryEvaluation& evaluation) {
  const EvaluationOptions& options = evaluation.options;
  std::string text = absl::StrFormat(
      "alignment %s; poses compared within %.0f ms; RPE over %g m and %g s (rmse)\n",
      AlignmentModeName(options.alignment), 1e3 * ToSeconds(options.max_time_difference),
      options.rpe_distance_m, options.rpe_time_s);
  absl::StrAppend(&text, TableHeader(), "one joint alignment\n", TableRow(evaluation.joint));
  if (evaluation.agents_in_joint.size() > 1) {
    for (const AlignedErrors& errors : evaluation.agents_in_joint) {
      absl::StrAppend(&text, TableRow(errors));
    }
    absl::StrAppend(&text, "each agent aligned alone (hides errors between agents)\n");
    for (size_t i = 0; i < evaluation.agents_alone.size(); ++i) {
      const auto& alone = evaluation.agents_alone[i];
      absl::StrAppend(&text, alone ? TableRow(*alone)
                                   : absl::StrCat("  ", evaluation.agents_in_joint[i].name,
                                                  ": too few matched poses\n"));
    }
  }
  return text + Details(evaluation.joint);
}

std::string EvaluationJson(const TrajectoryEvaluation& evaluation) {
  std::vector<std::string> agents;
  for (size_t i = 0; i < evaluation.agents_in_joint.size(); ++i) {
    const auto& alone = evaluation.agents_alone[i];
    agents.push_back(JsonObject({{"name", JsonString(evaluation.agents_in_joint[i].name)},
                                 {"joint_alignment", JsonErrors(evaluation.agents_in_joint[i])},
                                 {"own_alignment", alone ? JsonErrors(*alone) : "null"}}));
  }
  const EvaluationOptions& options = evaluation.options;
  return JsonObject({{"alignment", JsonString(AlignmentModeName(options.alignment))},
                     {"max_time_difference_s", JsonNumber(ToSeconds(options.max_time_difference))},
                     {"rpe_distance_m", JsonNumber(options.rpe_distance_m)},
                     {"rpe_time_s", JsonNumber(options.rpe_time_s)},
                     {"joint", JsonErrors(evaluation.joint)},
                     {"agents", absl::StrCat("[", absl::StrJoin(agents, ", "), "]")}}) +
         "\n";
}

MapPlot EvaluationPlot(const TrajectoryEvaluation& evaluation,
                       std::span<const TrajectoryPair> agents) {
  MapPlot plot;
  plot.title = "Estimate against ground truth";
  const ErrorStatistics& ate = evaluation.joint.ate_m;
  plot.subtitle = absl::StrFormat(
      "ATE rmse %.4f m, median %.4f m, max %.4f m over %.1f m; coverage %.3f; one %s alignment",
      ate.rmse, ate.median, ate.max, evaluation.joint.reference_path_m, evaluation.joint.coverage,
      AlignmentModeName(evaluation.options.alignment));
  const Timestamp start =
      evaluation.joint.poses.empty() ? Timestamp(0) : evaluation.joint.poses.front().time;
  for (const AlignedErrors& agent : evaluation.agents_in_joint) {
    PlotTrajectory trajectory;
    trajectory.name = absl::StrFormat("%s: ATE rmse %.4f m", agent.name, agent.ate_m.rmse);
    for (const PoseError& pose : agent.poses) {
      trajectory.positions.push_back(pose.estimate_in_reference);
      trajectory.times_s.push_back(ToSeconds(pose.time - start));
      trajectory.errors.push_back(pose.error_m);
    }
    plot.trajectories.push_back(std::move(trajectory));
  }
  std::set<const Trajectory*> drawn;
  for (const TrajectoryPair& agent : agents) {
    if (drawn.insert(agent.reference).second)
      plot.references.push_back(Positions(*agent.reference));
  }
  return plot;
}

}  // namespace portolan
