// trajectory, export: the map in the formats of other programs.
#include <iostream>

#include "common/base/concat.h"
#include "server/cli/command.h"
#include "server/cli/exports.h"
#include "server/cli/output_frame.h"
#include "server/evaluation/map_plot.h"

namespace portolan {
namespace {

// Without a component, poses of several worlds would end up in one file.
void WarnOfSeveralComponents(const std::vector<v1::TrajectorySegment>& segments) {
  for (const v1::TrajectorySegment& segment : segments) {
    if (segment.component_id() == segments.front().component_id()) continue;
    std::cerr << "portolan: the trajectory lies in several components, each with a world of its "
                 "own; choose one with --component\n";
    return;
  }
}

Status PrintSegmentsAsJson(const std::vector<v1::TrajectorySegment>& segments,
                           const std::string& path) {
  std::string text = "[";
  for (const v1::TrajectorySegment& segment : segments) {
    PORTOLAN_ASSIGN_OR_RETURN(const std::string json, ToJson(segment));
    text += Concat(text.size() > 1 ? ",\n" : "", json);
  }
  return WriteOutput(path, [&](std::ostream& out) { out << text << "]\n"; });
}

StatusOr<v1::LandmarkPage> AllLandmarks(const MapClient& client, int64_t component) {
  constexpr double kFar = 1e9;
  v1::QueryLandmarksRequest request;
  request.set_component_id(component);
  for (auto* corner :
       {request.mutable_box()->mutable_min(), request.mutable_box()->mutable_max()}) {
    const double value = corner == request.mutable_box()->mutable_min() ? -kFar : kFar;
    corner->set_x(value);
    corner->set_y(value);
    corner->set_z(value);
  }
  return client.QueryLandmarks(request);
}

Status ExportPly(const MapClient& client, int64_t component, OutputFrame frame,
                 const std::string& path) {
  PORTOLAN_ASSIGN_OR_RETURN(v1::LandmarkPage page, AllLandmarks(client, component));
  PORTOLAN_RETURN_IF_ERROR(ConvertLandmarks(client, frame, &page));
  return WriteOutput(path, [&](std::ostream& out) { WritePly(page, out); });
}

PlotTrajectory PlotOf(const std::string& agent,
                      const std::vector<v1::TrajectorySegment>& segments) {
  PlotTrajectory plot;
  plot.name = agent;
  for (const v1::TrajectorySegment& segment : segments) {
    for (int i = 0; i + 6 < segment.world_from_camera_size(); i += 7) {
      plot.positions.emplace_back(segment.world_from_camera(i + 4),
                                  segment.world_from_camera(i + 5),
                                  segment.world_from_camera(i + 6));
    }
  }
  return plot;
}

// Landmarks and keyframe paths of one component.
Status ExportPng(const MapClient& client, int64_t component, const std::string& path) {
  PORTOLAN_ASSIGN_OR_RETURN(const v1::LandmarkPage page, AllLandmarks(client, component));
  MapPlot plot;
  plot.length_unit = page.metric() ? "m" : "map units";
  plot.title = Concat("component ", page.component_id(), ", map version ", page.map_version());
  plot.subtitle = Concat(page.landmarks_size(), " landmarks");
  for (const v1::Landmark& landmark : page.landmarks()) {
    const v1::Vector3& point = landmark.point_in_world();
    plot.landmarks.emplace_back(point.x(), point.y(), point.z());
  }
  PORTOLAN_ASSIGN_OR_RETURN(const v1::ListAgentsResponse agents, client.ListAgents());
  for (const v1::AgentInfo& agent : agents.agents()) {
    v1::GetTrajectoryRequest request;
    request.set_agent_id(agent.agent_id());
    request.set_component_id(page.component_id());
    request.set_kind(v1::TRAJECTORY_KIND_KEYFRAMES);
    PORTOLAN_ASSIGN_OR_RETURN(const auto segments, client.GetTrajectory(request));
    plot.trajectories.push_back(PlotOf(agent.agent_id(), segments));
  }
  return WriteMapPlot(plot, path.empty() ? "map.png" : path);
}

// One file an agent in the folder `path`.
Status ExportTum(const MapClient& client, int64_t component, bool all_frames, OutputFrame frame,
                 const std::string& path) {
  PORTOLAN_ASSIGN_OR_RETURN(const v1::ListAgentsResponse agents, client.ListAgents());
  for (const v1::AgentInfo& agent : agents.agents()) {
    v1::GetTrajectoryRequest request;
    request.set_agent_id(agent.agent_id());
    request.set_component_id(component);
    request.set_kind(all_frames ? v1::TRAJECTORY_KIND_FRAMES : v1::TRAJECTORY_KIND_KEYFRAMES);
    PORTOLAN_ASSIGN_OR_RETURN(auto segments, client.GetTrajectory(request));
    PORTOLAN_RETURN_IF_ERROR(ConvertTrajectory(client, frame, &segments));
    if (component == 0) WarnOfSeveralComponents(segments);
    PORTOLAN_RETURN_IF_ERROR(
        WriteOutput(Concat(path.empty() ? "." : path, "/", agent.agent_id(), ".tum"),
                    [&](std::ostream& out) { WriteTum(segments, out); }));
  }
  return absl::OkStatus();
}

Status ExportG2o(const MapClient& client, int64_t component, const std::string& path) {
  v1::GetPoseGraphRequest request;
  request.set_component_id(component);
  PORTOLAN_ASSIGN_OR_RETURN(const v1::PoseGraphPage graph, client.GetPoseGraph(request));
  return WriteOutput(path, [&](std::ostream& out) { WriteG2o(graph, out); });
}

}  // namespace

int RunTrajectory(std::span<const std::string> args) {
  ClientOptions client;
  std::string agent, path;
  bool all_frames = false;
  int64_t component = 0;
  OptionTable table;
  client.AddTo(&table);
  table.Add("agent", &agent, "", "Whose; required.");
  table.Add("all_frames", &all_frames, "", "Every processed frame instead of keyframes.");
  table.Add("component", &component, "", "Only poses in this component; 0: in any.");
  table.Add("out", &path, "", "File to write; empty: standard output.");
  OutputFrame frame = OutputFrame::kWorld;
  AddOutputFrame(&table, &frame);
  CommandLine line;
  int exit_code;
  if (!ParseArguments(args,
                      "usage: portolan trajectory --agent NAME [flags]\nCamera poses in the world "
                      "as a TUM trajectory (timestamp tx ty tz qx qy qz qw), or as JSON.",
                      0, &table, &line, &exit_code)) {
    return exit_code;
  }
  v1::GetTrajectoryRequest request;
  request.set_agent_id(agent);
  request.set_component_id(component);
  request.set_kind(all_frames ? v1::TRAJECTORY_KIND_FRAMES : v1::TRAJECTORY_KIND_KEYFRAMES);
  const MapClient map(client.server, FromSeconds(client.timeout_s));
  auto segments = map.GetTrajectory(request);
  if (!segments.ok()) return Fail(segments.status());
  const Status converted = ConvertTrajectory(map, frame, &*segments);
  if (!converted.ok()) return Fail(converted);
  WarnOfSeveralComponents(*segments);
  const Status status =
      client.json ? PrintSegmentsAsJson(*segments, path)
                  : WriteOutput(path, [&](std::ostream& out) { WriteTum(*segments, out); });
  return status.ok() ? kExitOk : Fail(status);
}

int RunExport(std::span<const std::string> args) {
  ClientOptions client;
  std::string path;
  bool all_frames = false;
  int64_t component = 0;
  OptionTable table;
  client.AddTo(&table);
  table.Add("out", &path, "",
            "File to write, for tum the existing folder; empty: standard output, this folder.");
  table.Add("component", &component, "",
            "Only this component; 0: for ply the largest, else all of them.");
  table.Add("all_frames", &all_frames, "", "tum: every processed frame instead of keyframes.");
  OutputFrame frame = OutputFrame::kWorld;
  AddOutputFrame(&table, &frame);
  CommandLine line;
  int exit_code;
  constexpr std::string_view kUsage =
      "usage: portolan export ply|png|tum|g2o [flags]\n"
      "ply: landmarks as points. png: a picture of landmarks and paths, map.png. tum: one "
      "trajectory file an agent, NAME.tum. g2o: submaps and "
      "their relations as a pose graph with times in comments.";
  if (!ParseArguments(args, kUsage, 1, &table, &line, &exit_code)) return exit_code;
  const std::string format = line.positional.empty() ? "" : line.positional[0];
  const MapClient map(client.server, FromSeconds(client.timeout_s));
  Status status;
  if (format == "ply") {
    status = ExportPly(map, component, frame, path);
  } else if (format == "png") {
    status = ExportPng(map, component, path);
  } else if (format == "tum") {
    status = ExportTum(map, component, all_frames, frame, path);
  } else if (format == "g2o") {
    status = ExportG2o(map, component, path);
  } else {
    status = absl::InvalidArgumentError("name a format: ply, png, tum or g2o");
  }
  return status.ok() ? kExitOk : Fail(status);
}

}  // namespace portolan
