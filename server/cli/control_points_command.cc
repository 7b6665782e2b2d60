// control-points, georeference: what is known about positions, and how well the map fits it.
#include <cstdio>
#include <fstream>
#include <iostream>
#include <numbers>

#include "common/base/concat.h"
#include "server/cli/command.h"
#include "server/cli/control_point_text.h"

namespace portolan {
namespace {

constexpr std::string_view kControlPointsUsage =
    "usage: portolan control-points list|add|import|remove|origin [FILE] [flags]\n"
    "Surveyed points that images show. They put the map into the site's frame (east, north, up) "
    "and take its drift out; `portolan georeference` tells how well they fit.\n"
    "list: all of them. add: one, by flags. import FILE: many, one a line:\n"
    "  id,wgs84|grid,latitude or easting,longitude or northing,height,sigma_m,OBSERVATION ...\n"
    "remove: the one named by --id. origin: sets the site's origin by --wgs84 and, if there is a "
    "local grid, its grid coordinates by --position; without either it is withdrawn.\n"
    "An OBSERVATION is AGENT[/SESSION]:TIME:U:V[:SIGMA]: the time of a keyframe as `portolan "
    "trajectory` prints it, and the point's raw pixel with its standard deviation.";

struct ControlPointsOptions {
  std::string id;
  std::vector<double> wgs84;
  std::vector<double> position;
  double sigma = 0.02;
  std::vector<std::string> observations;
  bool replace = false;

  void AddTo(OptionTable* table) {
    table->Add("id", &id, "", "Name of the point: A-Z a-z 0-9 . _ -");
    table->Add("wgs84", &wgs84, "deg,deg,m", "Latitude, longitude, height above the ellipsoid.");
    table->Add("position", &position, "m", "Easting, northing, height in the local grid.");
    table->Add("sigma", &sigma, "m", "Standard deviation of each coordinate.");
    table->Add("observation", &observations, "", "At least two OBSERVATIONs, separated by commas.");
    table->Add("replace", &replace, "", "add, import: takes the place of a point of the same id.");
  }
};

void SetGeodetic(const std::vector<double>& numbers, v1::GeodeticPosition* position) {
  position->set_latitude_deg(numbers[0]);
  position->set_longitude_deg(numbers[1]);
  position->set_height_m(numbers[2]);
}

void SetVector(const std::vector<double>& numbers, v1::Vector3* vector) {
  vector->set_x(numbers[0]);
  vector->set_y(numbers[1]);
  vector->set_z(numbers[2]);
}

Status CheckTriples(const ControlPointsOptions& options) {
  for (const auto* numbers : {&options.wgs84, &options.position}) {
    if (!numbers->empty() && numbers->size() != 3) {
      return absl::InvalidArgumentError("--wgs84 and --position take 3 numbers, comma separated");
    }
  }
  return absl::OkStatus();
}

StatusOr<v1::ControlPoint> PointOf(const ControlPointsOptions& options) {
  if (options.wgs84.empty() == options.position.empty()) {
    return absl::InvalidArgumentError("give one of --wgs84 and --position");
  }
  v1::ControlPoint point;
  point.set_id(options.id);
  if (!options.wgs84.empty()) SetGeodetic(options.wgs84, point.mutable_geodetic());
  if (!options.position.empty()) SetVector(options.position, point.mutable_grid());
  point.set_sigma_m(options.sigma);
  for (const std::string& text : options.observations) {
    PORTOLAN_ASSIGN_OR_RETURN(*point.add_observations(), ParseObservation(text));
  }
  if (point.observations_size() < 2) {
    return absl::InvalidArgumentError("a control point needs at least 2 observations");
  }
  return point;
}

StatusOr<v1::ControlPoints> Import(const MapClient& client, const std::string& path, bool replace) {
  if (path.empty()) return absl::InvalidArgumentError("name the file to import");
  std::ifstream file(path);
  if (!file) return absl::NotFoundError(Concat("cannot read ", path));
  auto points = ParseControlPoints(file);
  if (!points.ok()) {
    return absl::InvalidArgumentError(Concat(path, ": ", points.status().message()));
  }
  v1::AddControlPointsRequest request;
  request.set_replace(replace);
  for (v1::ControlPoint& point : *points) *request.add_points() = std::move(point);
  return client.AddControlPoints(request);
}

StatusOr<v1::ControlPoints> Run(const std::string& action, const std::string& path,
                                const ControlPointsOptions& options, const MapClient& client) {
  PORTOLAN_RETURN_IF_ERROR(CheckTriples(options));
  if (action == "list") return client.ListControlPoints();
  if (action == "import") return Import(client, path, options.replace);
  if (action == "add") {
    v1::AddControlPointsRequest request;
    PORTOLAN_ASSIGN_OR_RETURN(*request.add_points(), PointOf(options));
    request.set_replace(options.replace);
    return client.AddControlPoints(request);
  }
  if (action == "remove") {
    if (options.id.empty()) return absl::InvalidArgumentError("name the point by --id");
    v1::RemoveControlPointsRequest request;
    request.add_ids(options.id);
    return client.RemoveControlPoints(request);
  }
  if (action == "origin") {
    v1::SetSiteOriginRequest request;
    if (!options.wgs84.empty()) {
      SetGeodetic(options.wgs84, request.mutable_origin()->mutable_geodetic());
    }
    if (!options.position.empty()) {
      SetVector(options.position, request.mutable_origin()->mutable_grid());
    }
    return client.SetSiteOrigin(request);
  }
  return absl::InvalidArgumentError("name an action: list, add, import, remove or origin");
}

std::string OriginText(const v1::SiteOrigin& origin) {
  char text[200] = "";
  if (origin.has_geodetic()) {
    std::snprintf(text, sizeof(text), "WGS84 %.9f %.9f %.3f", origin.geodetic().latitude_deg(),
                  origin.geodetic().longitude_deg(), origin.geodetic().height_m());
  }
  std::string result = text;
  const v1::Vector3& grid = origin.grid();
  if (!origin.has_geodetic() || grid.x() != 0 || grid.y() != 0 || grid.z() != 0) {
    std::snprintf(text, sizeof(text), "grid %.3f %.3f %.3f", grid.x(), grid.y(), grid.z());
    result += (result.empty() ? "" : ", ") + std::string(text);
  }
  return result;
}

void PrintPoints(const v1::ControlPoints& points) {
  if (points.has_origin()) std::cout << "origin: " << OriginText(points.origin()) << "\n";
  for (const v1::ControlPoint& point : points.points()) {
    if (point.has_geodetic()) {
      std::printf("%s wgs84 %.9f %.9f %.4f", point.id().c_str(), point.geodetic().latitude_deg(),
                  point.geodetic().longitude_deg(), point.geodetic().height_m());
    } else {
      std::printf("%s grid %.4f %.4f %.4f", point.id().c_str(), point.grid().x(), point.grid().y(),
                  point.grid().z());
    }
    std::printf(" sigma %.4f m, %d observations\n", point.sigma_m(), point.observations_size());
  }
  std::fflush(stdout);
}

const char* ModeText(v1::GeoreferenceMode mode) {
  switch (mode) {
    case v1::GEOREFERENCE_MODE_YAW:
      return ", fitted by yaw and translation";
    case v1::GEOREFERENCE_MODE_RIGID:
      return ", fitted by rotation and translation";
    case v1::GEOREFERENCE_MODE_SIMILARITY:
      return ", fitted by a similarity";
    default:
      return "";
  }
}

void PrintGeoreference(const v1::Georeference& component, bool with_residuals) {
  std::cout << "component " << component.component_id() << ": ";
  if (component.metric_submap_count() > 0) {
    std::printf("scale by %u submaps' sensors, rms %.2f %%; ", component.metric_submap_count(),
                100 * component.rms_log_scale());
  }
  if (component.vertical_submap_count() > 0) {
    std::printf("vertical by %u submaps' sensors, rms %.2f degrees; ",
                component.vertical_submap_count(),
                component.rms_tilt_rad() * 180 / std::numbers::pi);
  }
  std::fflush(stdout);
  if (!component.georeferenced()) {
    std::cout << "not georeferenced" << (component.problem().empty() ? "" : ": ")
              << component.problem() << "\n";
    return;
  }
  std::cout << "georeferenced (east, north, up in metres) about " << OriginText(component.origin())
            << ModeText(component.mode()) << "\n";
  std::printf("  %u control points, rms horizontal %.3f m, vertical %.3f m\n",
              component.control_point_count(), component.rms_control_horizontal_m(),
              component.rms_control_vertical_m());
  std::printf("  %u fixes, rms horizontal %.3f m, vertical %.3f m; %u outliers in all\n",
              component.fix_count(), component.rms_fix_horizontal_m(),
              component.rms_fix_vertical_m(), component.outlier_count());
  if (!component.problem().empty()) std::printf("  not used: %s\n", component.problem().c_str());
  if (!with_residuals) return;
  for (const v1::GeoreferenceResidual& one : component.residuals()) {
    std::printf("  %s %s %.9f: %.3f %.3f %.3f sigma %.3f%s\n",
                one.control_point_id().empty() ? "fix" : one.control_point_id().c_str(),
                one.agent_id().c_str(), static_cast<double>(one.time_ns()) * 1e-9, one.error().x(),
                one.error().y(), one.error().z(), one.sigma_m(), one.outlier() ? " outlier" : "");
  }
}

int PrintMessage(const google::protobuf::Message& message) {
  const StatusOr<std::string> json = ToJson(message);
  if (!json.ok()) return Fail(json.status());
  std::cout << *json << "\n";
  return kExitOk;
}

}  // namespace

int RunControlPoints(std::span<const std::string> args) {
  ClientOptions client;
  ControlPointsOptions options;
  OptionTable table;
  client.AddTo(&table);
  options.AddTo(&table);
  CommandLine line;
  int exit_code;
  if (!ParseArguments(args, kControlPointsUsage, 2, &table, &line, &exit_code)) return exit_code;
  const std::string action = line.positional.empty() ? "" : line.positional[0];
  const std::string path = line.positional.size() < 2 ? "" : line.positional[1];
  const auto points =
      Run(action, path, options, MapClient(client.server, FromSeconds(client.timeout_s)));
  if (!points.ok()) return Fail(points.status());
  if (client.json) return PrintMessage(*points);
  PrintPoints(*points);
  return kExitOk;
}

int RunGeoreference(std::span<const std::string> args) {
  ClientOptions client;
  int64_t component = 0;
  bool residuals = false;
  OptionTable table;
  client.AddTo(&table);
  table.Add("component", &component, "", "Only this one; 0: all of which something is known.");
  table.Add("residuals", &residuals, "",
            "Every control point and fix: map minus known position (east, north, up).");
  CommandLine line;
  int exit_code;
  if (!ParseArguments(args,
                      "usage: portolan georeference [flags]\nHow components lie on the earth or in "
                      "the local grid: frame, origin, and what is left of the errors at control "
                      "points and satellite fixes, of metric scales and verticals.",
                      0, &table, &line, &exit_code)) {
    return exit_code;
  }
  v1::GetGeoreferenceRequest request;
  request.set_component_id(component);
  request.set_summary_only(!residuals);
  const auto response =
      MapClient(client.server, FromSeconds(client.timeout_s)).GetGeoreference(request);
  if (!response.ok()) return Fail(response.status());
  if (client.json) return PrintMessage(*response);
  if (response->components().empty()) {
    std::cout
        << "neither positions (control points, satellite fixes) nor metric sensors are known\n";
  }
  for (const v1::Georeference& one : response->components()) PrintGeoreference(one, residuals);
  std::cout.flush();
  std::fflush(stdout);
  return kExitOk;
}

}  // namespace portolan
