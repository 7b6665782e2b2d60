// landmarks: fused landmarks in a region or near a point.
#include <cmath>
#include <cstdio>
#include <iostream>

#include "common/base/concat.h"
#include "server/cli/command.h"
#include "server/cli/output_frame.h"

namespace portolan {
namespace {

struct LandmarksOptions {
  std::vector<double> box;
  std::vector<double> sphere;
  std::vector<double> near;
  uint32_t count = 10;
  int64_t component = 0;
  uint32_t limit = 0;
  uint32_t min_observations = 0;

  void AddTo(OptionTable* table) {
    table->Add("box", &box, "", "x0,y0,z0,x1,y1,z1: all inside, in ascending id.");
    table->Add("sphere", &sphere, "", "x,y,z,r: all inside, nearest first.");
    table->Add("near", &near, "", "x,y,z: the nearest ones, nearest first.");
    table->Add("k", &count, "", "How many nearest ones (also -k).");
    table->Add("component", &component, "", "Whose world is meant; 0: the largest component's.");
    table->Add("limit", &limit, "", "At most so many; 0: all.");
    table->Add("min_observations", &min_observations, "",
               "Leaves out landmarks that fewer keyframes observe.");
  }
};

void Set(const std::vector<double>& numbers, size_t first, v1::Vector3* vector) {
  vector->set_x(numbers[first]);
  vector->set_y(numbers[first + 1]);
  vector->set_z(numbers[first + 2]);
}

StatusOr<v1::QueryLandmarksRequest> MakeRequest(const LandmarksOptions& options) {
  v1::QueryLandmarksRequest request;
  request.set_component_id(options.component);
  request.set_limit(options.limit);
  request.set_min_observation_count(options.min_observations);
  if (!options.box.empty() + !options.sphere.empty() + !options.near.empty() != 1) {
    return absl::InvalidArgumentError("give one of --box, --sphere and --near");
  }
  if (options.box.size() == 6) {
    Set(options.box, 0, request.mutable_box()->mutable_min());
    Set(options.box, 3, request.mutable_box()->mutable_max());
  } else if (options.sphere.size() == 4) {
    Set(options.sphere, 0, request.mutable_sphere()->mutable_center());
    request.mutable_sphere()->set_radius(options.sphere[3]);
  } else if (options.near.size() == 3) {
    Set(options.near, 0, request.mutable_nearest()->mutable_point());
    request.mutable_nearest()->set_count(options.count);
  } else {
    return absl::InvalidArgumentError(
        "--box takes 6 numbers, --sphere 4 and --near 3, separated by commas");
  }
  return request;
}

// `digits`: after the decimal point of the first two coordinates.
void Print(const v1::LandmarkPage& page, int digits) {
  std::printf(
      "# map version %llu, component %lld, %s; id x y z sigma_x sigma_y sigma_z "
      "observations agents\n",
      static_cast<unsigned long long>(page.map_version()),
      static_cast<long long>(page.component_id()), page.metric() ? "metres" : "no metric scale");
  for (const v1::Landmark& landmark : page.landmarks()) {
    const v1::Vector3& point = landmark.point_in_world();
    std::string agents;
    for (const uint32_t agent : landmark.agents()) {
      agents += Concat(agents.empty() ? "" : ",", page.agent_ids(static_cast<int>(agent)));
    }
    const auto sigma = [&](int i) {
      return landmark.covariance_size() == 6 ? std::sqrt(landmark.covariance(i)) : NAN;
    };
    std::printf("%lld %.*f %.*f %.6f %.2g %.2g %.2g %u %s\n",
                static_cast<long long>(landmark.landmark_id()), digits, point.x(), digits,
                point.y(), point.z(), sigma(0), sigma(3), sigma(5), landmark.observation_count(),
                agents.c_str());
  }
}

}  // namespace

int RunLandmarks(std::span<const std::string> args) {
  ClientOptions client;
  LandmarksOptions options;
  OptionTable table;
  client.AddTo(&table);
  options.AddTo(&table);
  OutputFrame frame = OutputFrame::kWorld;
  AddOutputFrame(&table, &frame);
  CommandLine line;
  int exit_code;
  if (!ParseArguments(args,
                      "usage: portolan landmarks --box x0,y0,z0,x1,y1,z1 | --sphere x,y,z,r | "
                      "--near x,y,z [-k N] [flags]\nFused landmarks with standard deviations, "
                      "number of observations and the agents that saw them.",
                      0, &table, &line, &exit_code)) {
    return exit_code;
  }
  const auto request = MakeRequest(options);
  if (!request.ok()) return Fail(request.status());
  const MapClient map(client.server, FromSeconds(client.timeout_s));
  auto page = map.QueryLandmarks(*request);
  if (!page.ok()) return Fail(page.status());
  const Status converted = ConvertLandmarks(map, frame, &*page);
  if (!converted.ok()) return Fail(converted);
  if (!client.json) {
    Print(*page, frame == OutputFrame::kWgs84 ? 10 : 6);
    return kExitOk;
  }
  const StatusOr<std::string> json = ToJson(*page);
  if (!json.ok()) return Fail(json.status());
  std::cout << *json << "\n";
  return kExitOk;
}

}  // namespace portolan
