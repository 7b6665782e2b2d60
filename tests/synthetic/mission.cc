#include "tests/synthetic/mission.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "tests/synthetic/random.h"

namespace portolan::synthetic {
namespace {

using Eigen::Vector3d;

constexpr double kKnotInterval_s = 0.25;
constexpr double kLoop_rad = 2 * M_PI;
constexpr double kLaps = 1.08;  // in loop_time_s, so that an agent sees its start again

// What the missions differ in.
struct MissionPlan {
  const char* name;
  int agents;
  double texture_amount;
  bool repeated_texture;
  bool turns_on_the_spot;
};

constexpr MissionPlan kPlans[] = {
    {"three_agents", 3, 1.0, false, false}, {"five_agents", 5, 1.0, false, false},
    {"loop", 1, 1.0, false, false},         {"pure_rotation", 1, 1.0, false, true},
    {"low_texture", 1, 0.15, false, false}, {"repeated_texture", 3, 1.0, true, false},
};

const MissionPlan* FindPlan(const std::string& name) {
  const auto found = std::find_if(std::begin(kPlans), std::end(kPlans),
                                  [&](const MissionPlan& plan) { return plan.name == name; });
  return found == std::end(kPlans) ? nullptr : found;
}

// An ellipse round the hall's centre, looked into, with a hand's or an air vehicle's unrest.
struct LoopShape {
  double half_length_m, half_width_m, height_m;
  double start_rad;
  double direction;  // 1: anticlockwise
  double wave_phase_rad;
};

LoopShape MakeShape(int agent, int agents, Random* random) {
  LoopShape shape;
  shape.half_length_m = random->Uniform(2.7, 3.0);
  shape.half_width_m = random->Uniform(2.05, 2.35);
  shape.height_m = random->Uniform(1.25, 1.65);
  shape.start_rad = kLoop_rad * agent / agents + random->Uniform(-0.1, 0.1);
  shape.direction = agent % 2 == 0 ? 1 : -1;
  shape.wave_phase_rad = random->Uniform(0, kLoop_rad);
  return shape;
}

// Share of the loop after a share of the time: at rest at both ends, constant speed between ramps
// of the given share. The speed is smoothstep(t / ramp), mirrored at the end; this is its integral.
double EasedShare(double share, double ramp) {
  const double s = std::min({share / ramp, (1 - share) / ramp, 1.0});
  const double ramp_path = ramp * (s * s * s - 0.5 * s * s * s * s);
  const double total = 1 - ramp;  // both ramps have the mean speed 1/2
  if (share < ramp) return ramp_path / total;
  if (share > 1 - ramp) return 1 - ramp_path / total;
  return (share - 0.5 * ramp) / total;
}

PathKnot KnotAt(const LoopShape& shape, double lap_rad, double extra_yaw_rad) {
  const double angle = shape.start_rad + shape.direction * lap_rad;
  const double wave = angle + shape.wave_phase_rad;
  PathKnot knot;
  knot.position_m = {shape.half_length_m * std::cos(angle), shape.half_width_m * std::sin(angle),
                     shape.height_m + 0.15 * std::sin(2 * wave)};
  // The direction to the centre, without a jump at the full turn, and a slow sway.
  const double inward = std::atan2(-knot.position_m.y(), -knot.position_m.x());
  const double turns = std::round((angle + M_PI - inward) / kLoop_rad);
  knot.yaw_pitch_roll_rad = {inward + kLoop_rad * turns + 0.2 * std::sin(3 * wave) + extra_yaw_rad,
                             0.10 + 0.06 * std::sin(2 * wave + 1), 0.05 * std::sin(3 * wave + 2)};
  return knot;
}

void AddUnrest(Random* random, PathKnot* knot) {
  knot->position_m += 0.006 * random->Normal3();
  knot->yaw_pitch_roll_rad += 0.006 * random->Normal3();
}

// For the mission pure_rotation: the middle half of the time stands still and turns there and back.
struct Progress {
  double share;  // of the loop
  double extra_yaw_rad;
  bool stands;
};

Progress TurnOnTheSpot(double share) {
  const double first = 0.3, last = 0.7;
  if (share < first) return {0.5 * EasedShare(share / first, 0.3), 0, false};
  if (share > last) {
    return {0.5 + 0.5 * EasedShare((share - last) / (1 - last), 0.3), 0, false};
  }
  const double within = (share - first) / (last - first);
  return {0.5, 1.2 * std::sin(kLoop_rad * within) * std::sin(M_PI * within), true};
}

BodyPath MakePath(const LoopShape& shape, const MissionOptions& options, bool turns_on_the_spot,
                  Random* random) {
  const double duration_s = std::max(options.loop_time_s, options.frames / options.frame_rate_hz);
  const double lap_rad = kLaps * kLoop_rad * duration_s / options.loop_time_s;
  const int intervals = static_cast<int>(std::ceil(duration_s / kKnotInterval_s)) + 1;
  std::vector<PathKnot> knots;
  for (int i = -1; i <= intervals + 1; ++i) {
    const double share = std::clamp(i * kKnotInterval_s / duration_s, 0.0, 1.0);
    const Progress progress =
        turns_on_the_spot ? TurnOnTheSpot(share) : Progress{EasedShare(share, 0.08), 0, false};
    PathKnot knot = KnotAt(shape, lap_rad * progress.share, progress.extra_yaw_rad);
    if (!progress.stands) AddUnrest(random, &knot);
    knots.push_back(knot);
  }
  return BodyPath(std::move(knots), kKnotInterval_s);
}

}  // namespace

CameraIntrinsics MissionOptions::EurocLikeCamera() {
  CameraIntrinsics camera;
  camera.width_px = 752;
  camera.height_px = 480;
  camera.fx_px = 458.654, camera.fy_px = 457.296;
  camera.cx_px = 367.215, camera.cy_px = 248.375;
  camera.distortion = DistortionModel::kRadTan;
  camera.coefficients = {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0};
  return camera;
}

CameraIntrinsics MissionOptions::SmallCamera() {
  CameraIntrinsics camera = EurocLikeCamera();
  camera.width_px /= 2, camera.height_px /= 2;
  camera.fx_px /= 2, camera.fy_px /= 2;
  camera.cx_px = 0.5 * camera.cx_px - 0.25, camera.cy_px = 0.5 * camera.cy_px - 0.25;
  return camera;
}

Status MissionOptions::Validate() const {
  if (FindPlan(name) == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrCat("unknown mission '", name, "'; one of ", absl::StrJoin(MissionNames(), ", ")));
  }
  if (frames < 2) return absl::InvalidArgumentError("frames must be at least 2");
  if (!(frame_rate_hz > 0) || !(imu.rate_hz > 0) || !(loop_time_s > 0)) {
    return absl::InvalidArgumentError(
        "frame_rate_hz, imu.rate_hz and loop_time_s must be positive");
  }
  if (!(stereo_baseline_m >= 0)) {
    return absl::InvalidArgumentError("stereo_baseline_m must not be negative");
  }
  if (!(range_rate_hz >= 0 && range_rate_hz <= 1e4)) {
    return absl::InvalidArgumentError("range_rate_hz must be within 0 and 10000");
  }
  if (!(effects.noise_sigma >= 0) || !(effects.shutter_s >= 0) || effects.blur_samples < 1 ||
      !(effects.exposure_swing >= 0 && effects.exposure_swing < 1)) {
    return absl::InvalidArgumentError(
        "effects: noise_sigma and shutter_s must not be negative, blur_samples at least 1, "
        "exposure_swing in [0, 1)");
  }
  return absl::OkStatus();
}

std::vector<std::string> MissionNames() {
  std::vector<std::string> names;
  for (const MissionPlan& plan : kPlans) names.emplace_back(plan.name);
  return names;
}

Mission Mission::OfSecondCamera() const {
  Mission second = *this;
  second.body_from_camera =
      body_from_camera * Rigid3{Eigen::Quaterniond::Identity(), {options.stereo_baseline_m, 0, 0}};
  second.options.seed = options.seed + 500000;  // of the noise: the world is there already
  return second;
}

Timestamp Mission::FrameTime(int frame) const {
  return options.start_time + FromSeconds(FrameTimeSinceStart_s(frame));
}

double Mission::FrameTimeSinceStart_s(int frame) const { return frame / options.frame_rate_hz; }

Rigid3 Mission::WorldFromCamera(const AgentPlan& agent, double time_s) const {
  return agent.path.At(time_s).world_from_body * body_from_camera;
}

StatusOr<Mission> MakeMission(const MissionOptions& options) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  PORTOLAN_RETURN_IF_ERROR(CameraModel::Create(options.camera).status());
  const MissionPlan& plan = *FindPlan(options.name);
  Mission mission;
  mission.options = options;
  WorldOptions world;
  world.seed = options.seed;
  world.texture_amount = plan.texture_amount;
  world.repeated_texture = plan.repeated_texture;
  mission.world = MakeHall(world);
  // The camera looks along the body's x axis, a hand's breadth ahead of the IMU.
  Eigen::Matrix3d rotation;
  rotation << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  mission.body_from_camera = {Eigen::Quaterniond(rotation), {0.06, 0.02, -0.01}};
  Random random(options.seed * 7919 + 17);
  for (int i = 0; i < plan.agents; ++i) {
    const LoopShape shape = MakeShape(i, plan.agents, &random);
    mission.agents.push_back(
        {absl::StrCat("agent", i), MakePath(shape, options, plan.turns_on_the_spot, &random)});
  }
  return mission;
}

}  // namespace portolan::synthetic
