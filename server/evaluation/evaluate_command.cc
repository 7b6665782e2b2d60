#include "server/evaluation/evaluate_command.h"

#include <deque>
#include <filesystem>
#include <iostream>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "common/camera/calibration.h"
#include "common/trajectory/evaluation.h"
#include "common/trajectory/trajectory_io.h"
#include "server/evaluation/evaluation_report.h"
#include "server/evaluation/map_plot.h"

namespace portolan {
namespace {

constexpr char kUsage[] =
    R"(Usage: portolan evaluate --estimate FILE... --groundtruth FILE... [options]

Compares trajectories with ground truth: ATE, RPE, coverage, scale error. Several agents are
evaluated under one joint alignment, and each alone.

  --estimate FILE        a trajectory; repeat it for several agents
  --groundtruth FILE     ground truth for all agents, or repeat it, one for each estimate
                         Files: TUM, EuRoC csv (told by its commas), or KITTI as POSES,TIMES
  --name NAME            label of an estimate, in order (its file name, with its folder where
                         two are the same)
  --align MODE           none, yaw, se3 or sim3 (sim3)
  --stamps FILE          times of the images (first column, seconds): the ground truth is
                         interpolated to them, so that coverage counts images; once or one for
                         each estimate
  --camera FILE          sensor.yaml with T_BS: the ground truth is the body's and the estimate
                         the camera's
  --max-time-difference SECONDS
                         of poses that are compared, and of coverage (0.02)
  --rpe-distance METRES  path length of relative errors (1)
  --rpe-time SECONDS     time of relative errors (1)
  --json                 print JSON instead of a table
  --plot FILE            write a PNG: views from above and from the side, errors over time
  --help
)";

struct EvaluateArguments {
  std::vector<std::string> estimates, groundtruths, names, stamps;
  std::string camera, plot;
  EvaluationOptions options;
  bool json = false, help = false;
};

StatusOr<double> PositiveNumber(const std::string& flag, const std::string& value) {
  double number = 0;
  if (!absl::SimpleAtod(value, &number) || !(number > 0) || !(number < 1e9)) {
    return absl::InvalidArgumentError(absl::StrCat(flag, ": not a positive number: '", value, "'"));
  }
  return number;
}

Status StoreValue(const std::string& flag, const std::string& value, EvaluateArguments* arguments) {
  if (flag == "--estimate") {
    arguments->estimates.push_back(value);
  } else if (flag == "--groundtruth") {
    arguments->groundtruths.push_back(value);
  } else if (flag == "--name") {
    arguments->names.push_back(value);
  } else if (flag == "--stamps") {
    arguments->stamps.push_back(value);
  } else if (flag == "--camera") {
    arguments->camera = value;
  } else if (flag == "--plot") {
    arguments->plot = value;
  } else if (flag == "--align") {
    PORTOLAN_ASSIGN_OR_RETURN(arguments->options.alignment, ParseAlignmentMode(value));
  } else if (flag == "--max-time-difference") {
    PORTOLAN_ASSIGN_OR_RETURN(const double seconds, PositiveNumber(flag, value));
    arguments->options.max_time_difference = FromSeconds(seconds);
  } else if (flag == "--rpe-distance") {
    PORTOLAN_ASSIGN_OR_RETURN(arguments->options.rpe_distance_m, PositiveNumber(flag, value));
  } else if (flag == "--rpe-time") {
    PORTOLAN_ASSIGN_OR_RETURN(arguments->options.rpe_time_s, PositiveNumber(flag, value));
  } else {
    return absl::InvalidArgumentError(absl::StrCat("unknown option ", flag));
  }
  return absl::OkStatus();
}

Status CheckCounts(const EvaluateArguments& arguments) {
  const size_t agents = arguments.estimates.size();
  if (agents == 0) return absl::InvalidArgumentError("--estimate is missing");
  if (arguments.groundtruths.empty()) {
    return absl::InvalidArgumentError("--groundtruth is missing");
  }
  const auto fits = [&](size_t count) { return count <= 1 || count == agents; };
  if (!fits(arguments.groundtruths.size()) || !fits(arguments.stamps.size())) {
    return absl::InvalidArgumentError(
        "--groundtruth and --stamps are given once, or once for each --estimate");
  }
  if (arguments.names.size() > agents) {
    return absl::InvalidArgumentError("more --name than --estimate");
  }
  return absl::OkStatus();
}

StatusOr<EvaluateArguments> ParseArguments(std::span<const std::string> args) {
  EvaluateArguments arguments;
  for (size_t i = 0; i < args.size(); ++i) {
    const std::string& flag = args[i];
    if (flag == "--help") {
      arguments.help = true;
      return arguments;
    }
    if (flag == "--json") {
      arguments.json = true;
      continue;
    }
    if (i + 1 == args.size()) {
      return absl::InvalidArgumentError(absl::StrCat(flag, ": unknown, or its value is missing"));
    }
    PORTOLAN_RETURN_IF_ERROR(StoreValue(flag, args[++i], &arguments));
  }
  PORTOLAN_RETURN_IF_ERROR(CheckCounts(arguments));
  return arguments;
}

// A file, or KITTI's two as POSES,TIMES.
StatusOr<Trajectory> ReadAny(const std::string& text) {
  const std::vector<std::string> parts = absl::StrSplit(text, ',');
  if (parts.size() == 2) return ReadKittiTrajectory(parts[0], parts[1]);
  return ReadTrajectory(text);
}

StatusOr<Trajectory> ReadReference(const std::string& groundtruth, const std::string& stamps,
                                   const std::optional<Rigid3>& body_from_camera) {
  PORTOLAN_ASSIGN_OR_RETURN(Trajectory reference, ReadAny(groundtruth));
  if (!stamps.empty()) {
    PORTOLAN_ASSIGN_OR_RETURN(const std::vector<Timestamp> times, ReadTimes(stamps));
    reference = ResampleTrajectory(reference, times);
  }
  if (body_from_camera) {
    for (StampedPose& pose : reference) {
      pose.world_from_body = pose.world_from_body * *body_from_camera;
    }
  }
  if (reference.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(groundtruth, ": no poses"));
  }
  return reference;
}

StatusOr<std::optional<Rigid3>> ReadBodyFromCamera(const std::string& path) {
  if (path.empty()) return std::optional<Rigid3>();
  PORTOLAN_ASSIGN_OR_RETURN(const CameraCalibration calibration, ReadCameraCalibration(path));
  if (!calibration.body_from_camera) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": no T_BS"));
  }
  return calibration.body_from_camera;
}

// Owns what the pairs point to. A deque's elements stay where they are.
struct LoadedAgents {
  std::deque<Trajectory> trajectories;
  std::vector<TrajectoryPair> pairs;
};

// File names, or, where two are the same, with their folders'.
std::vector<std::string> LabelsOf(const std::vector<std::string>& paths) {
  std::set<std::string> names;
  for (const std::string& path : paths) {
    names.insert(std::filesystem::path(path).filename().string());
  }
  std::vector<std::string> labels;
  for (const std::string& text : paths) {
    const std::filesystem::path path(text);
    labels.push_back(names.size() == paths.size()
                         ? path.filename().string()
                         : (path.parent_path().filename() / path.filename()).string());
  }
  return labels;
}

StatusOr<LoadedAgents> LoadAgents(const EvaluateArguments& arguments) {
  PORTOLAN_ASSIGN_OR_RETURN(const std::optional<Rigid3> body_from_camera,
                            ReadBodyFromCamera(arguments.camera));
  const auto at = [](const std::vector<std::string>& list, size_t i) {
    return list.empty() ? std::string() : list[list.size() == 1 ? 0 : i];
  };
  const std::vector<std::string> labels = LabelsOf(arguments.estimates);
  LoadedAgents agents;
  const bool is_shared = arguments.groundtruths.size() == 1 && arguments.stamps.size() <= 1;
  for (size_t i = 0; i < arguments.estimates.size(); ++i) {
    TrajectoryPair pair;
    pair.name = i < arguments.names.size() ? arguments.names[i] : labels[i];
    if (is_shared && i > 0) {
      pair.reference = agents.pairs[0].reference;
    } else {
      PORTOLAN_ASSIGN_OR_RETURN(
          Trajectory reference,
          ReadReference(at(arguments.groundtruths, i), at(arguments.stamps, i), body_from_camera));
      pair.reference = &agents.trajectories.emplace_back(std::move(reference));
    }
    PORTOLAN_ASSIGN_OR_RETURN(Trajectory estimate, ReadAny(arguments.estimates[i]));
    pair.estimate = &agents.trajectories.emplace_back(std::move(estimate));
    agents.pairs.push_back(std::move(pair));
  }
  return agents;
}

Status Evaluate(const EvaluateArguments& arguments, std::ostream& output) {
  PORTOLAN_ASSIGN_OR_RETURN(const LoadedAgents agents, LoadAgents(arguments));
  PORTOLAN_ASSIGN_OR_RETURN(const TrajectoryEvaluation evaluation,
                            EvaluateTrajectories(agents.pairs, arguments.options));
  output << (arguments.json ? EvaluationJson(evaluation) : EvaluationText(evaluation));
  if (arguments.plot.empty()) return absl::OkStatus();
  return WriteMapPlot(EvaluationPlot(evaluation, agents.pairs), arguments.plot);
}

}  // namespace

int RunEvaluate(std::span<const std::string> args, std::ostream& output, std::ostream& errors) {
  const StatusOr<EvaluateArguments> arguments = ParseArguments(args);
  if (!arguments.ok()) {
    errors << "portolan evaluate: " << arguments.status().message() << "\n\n" << kUsage;
    return 2;
  }
  if (arguments->help) {
    output << kUsage;
    return 0;
  }
  const Status status = Evaluate(*arguments, output);
  if (status.ok()) return 0;
  errors << "portolan evaluate: " << status.message() << "\n";
  return 1;
}

int RunEvaluate(std::span<const std::string> args) {
  return RunEvaluate(args, std::cout, std::cerr);
}

}  // namespace portolan
