// portolan-synthetic: renders a mission to disk in EuRoC layout.
#include <atomic>
#include <chrono>
#include <iostream>
#include <opencv2/core/utility.hpp>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "common/trajectory/trajectory.h"
#include "tests/synthetic/euroc_writer.h"
#include "tests/synthetic/mission.h"

namespace portolan::synthetic {
namespace {

constexpr char kUsage[] = R"(Usage: portolan-synthetic --out FOLDER [options]

Renders the cameras of one or more agents that fly through a textured hall, with exact ground
truth and IMU samples, to FOLDER/agent0, FOLDER/agent1, ... in EuRoC layout.

  --out FOLDER        where to write; made if missing
  --mission NAME      %s
                      (three_agents)
  --seed N            world, paths, noise (1)
  --frames N          images of each agent (300)
  --rate HZ           images a second (20)
  --size WxH          image size; the field of view stays that of 752x480 (752x480)
  --distortion MODEL  none, radtan or equidistant (radtan)
  --noise SIGMA       noise of a pixel in grey levels (2)
  --exposure SWING    share by which the exposure swings (0.2)
  --shutter SECONDS   motion blur: time that the shutter is open (0)
  --stereo METRES     a second camera so far to the right of the first (0: none)
  --ranges HZ         a laser range finder fixed to the camera (0: none)
  --format EXT        png, jpg or pgm (jpg)
  --threads N         agents rendered at the same time (number of cores)
  --help
)";

struct Arguments {
  MissionOptions mission;
  EurocWriterOptions writer;
  std::string folder;
  int threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  bool help = false;
};

Status BadValue(const std::string& flag, const std::string& value) {
  return absl::InvalidArgumentError(absl::StrCat(flag, ": bad value '", value, "'"));
}

Status ParseSize(const std::string& value, CameraIntrinsics* camera) {
  const size_t cross = value.find('x');
  int width = 0, height = 0;
  if (cross == std::string::npos || !absl::SimpleAtoi(value.substr(0, cross), &width) ||
      !absl::SimpleAtoi(value.substr(cross + 1), &height) || width < 16 || height < 16 ||
      width > 8192 || height > 8192) {
    return BadValue("--size", value);
  }
  const double scale_x = static_cast<double>(width) / camera->width_px;
  const double scale_y = static_cast<double>(height) / camera->height_px;
  // One factor for both focal lengths, so that pixels stay square.
  const double scale = std::max(scale_x, scale_y);
  camera->fx_px *= scale, camera->fy_px *= scale;
  camera->cx_px = (camera->cx_px + 0.5) * scale_x - 0.5;
  camera->cy_px = (camera->cy_px + 0.5) * scale_y - 0.5;
  camera->width_px = width, camera->height_px = height;
  return absl::OkStatus();
}

Status ParseDistortion(const std::string& value, CameraIntrinsics* camera) {
  if (value == "radtan") return absl::OkStatus();
  if (value == "none") {
    camera->distortion = DistortionModel::kNone;
    camera->coefficients = {};
  } else if (value == "equidistant") {
    camera->distortion = DistortionModel::kEquidistant;
    camera->coefficients = {-0.02, 0.005, -0.003, 0.0007, 0};
  } else {
    return BadValue("--distortion", value);
  }
  return absl::OkStatus();
}

Status ParseNumber(const std::string& flag, const std::string& value, Arguments* arguments) {
  MissionOptions& mission = arguments->mission;
  const auto store = [&](bool is_parsed) {
    return is_parsed ? absl::OkStatus() : BadValue(flag, value);
  };
  if (flag == "--seed") return store(absl::SimpleAtoi(value, &mission.seed));
  if (flag == "--frames") return store(absl::SimpleAtoi(value, &mission.frames));
  if (flag == "--rate") return store(absl::SimpleAtod(value, &mission.frame_rate_hz));
  if (flag == "--noise") return store(absl::SimpleAtod(value, &mission.effects.noise_sigma));
  if (flag == "--exposure") return store(absl::SimpleAtod(value, &mission.effects.exposure_swing));
  if (flag == "--stereo") return store(absl::SimpleAtod(value, &mission.stereo_baseline_m));
  if (flag == "--ranges") return store(absl::SimpleAtod(value, &mission.range_rate_hz));
  if (flag == "--shutter") return store(absl::SimpleAtod(value, &mission.effects.shutter_s));
  if (flag == "--threads") {
    return store(absl::SimpleAtoi(value, &arguments->threads) && arguments->threads >= 1);
  }
  return absl::InvalidArgumentError(absl::StrCat("unknown option ", flag));
}

StatusOr<Arguments> ParseArguments(const std::vector<std::string>& words) {
  Arguments arguments;
  for (size_t i = 0; i < words.size(); i += 2) {
    const std::string& flag = words[i];
    if (flag == "--help") {
      arguments.help = true;
      return arguments;
    }
    if (i + 1 == words.size()) {
      return absl::InvalidArgumentError(absl::StrCat(flag, " needs a value"));
    }
    const std::string& value = words[i + 1];
    if (flag == "--out") {
      arguments.folder = value;
    } else if (flag == "--mission") {
      arguments.mission.name = value;
    } else if (flag == "--format") {
      arguments.writer.image_format = value;
    } else if (flag == "--size") {
      PORTOLAN_RETURN_IF_ERROR(ParseSize(value, &arguments.mission.camera));
    } else if (flag == "--distortion") {
      PORTOLAN_RETURN_IF_ERROR(ParseDistortion(value, &arguments.mission.camera));
    } else {
      PORTOLAN_RETURN_IF_ERROR(ParseNumber(flag, value, &arguments));
    }
  }
  if (arguments.folder.empty()) return absl::InvalidArgumentError("--out is missing");
  PORTOLAN_RETURN_IF_ERROR(arguments.writer.Validate());
  return arguments;
}

// Renders the agents, several at a time; the first error wins.
Status WriteAgents(const Mission& mission, const Arguments& arguments) {
  const int agents = static_cast<int>(mission.agents.size());
  std::vector<Status> results(mission.agents.size());
  std::atomic<int> next = 0;
  std::vector<std::thread> workers;
  for (int i = 0; i < std::min(agents, arguments.threads); ++i) {
    workers.emplace_back([&] {
      for (int agent = next++; agent < agents; agent = next++) {
        results[static_cast<size_t>(agent)] =
            WriteEurocAgent(mission, agent, arguments.folder, arguments.writer);
      }
    });
  }
  for (std::thread& worker : workers) worker.join();
  for (const Status& result : results) PORTOLAN_RETURN_IF_ERROR(result);
  return absl::OkStatus();
}

Status Run(const Arguments& arguments) {
  cv::setNumThreads(1);  // the agents are the parallel work
  const auto begin = std::chrono::steady_clock::now();
  PORTOLAN_ASSIGN_OR_RETURN(const Mission mission, MakeMission(arguments.mission));
  PORTOLAN_RETURN_IF_ERROR(WriteAgents(mission, arguments));
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  for (size_t i = 0; i < mission.agents.size(); ++i) {
    std::cout << absl::StrCat(arguments.folder, "/", mission.agents[i].name, ": ",
                              mission.options.frames, " frames, path ",
                              PathLength(CameraGroundTruth(mission, static_cast<int>(i))), " m\n");
  }
  const double frames = static_cast<double>(mission.agents.size()) * mission.options.frames;
  std::cout << absl::StrCat("rendered ", frames, " frames in ", seconds, " s (", frames / seconds,
                            " frames a second)\n");
  return absl::OkStatus();
}

void PrintUsage(std::ostream& output) {
  std::string usage = kUsage;
  usage.replace(usage.find("%s"), 2, absl::StrJoin(MissionNames(), ", "));
  output << usage;
}

}  // namespace
}  // namespace portolan::synthetic

int main(int argc, char** argv) {
  using portolan::synthetic::PrintUsage;
  const auto arguments =
      portolan::synthetic::ParseArguments(std::vector<std::string>(argv + 1, argv + argc));
  if (!arguments.ok()) {
    std::cerr << "portolan-synthetic: " << arguments.status().message() << "\n\n";
    PrintUsage(std::cerr);
    return 2;
  }
  if (arguments->help) {
    PrintUsage(std::cout);
    return 0;
  }
  const portolan::Status status = portolan::synthetic::Run(*arguments);
  if (!status.ok()) std::cerr << "portolan-synthetic: " << status.message() << "\n";
  return status.ok() ? 0 : 1;
}
