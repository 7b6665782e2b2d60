// What the agent does under difficult images: survives them, closes its submap honestly, or uploads
// what is wrong. One line an effect.
//
//   portolan-image-effects
//
// A vehicle flies through the rendered hall, 200 frames of 376 x 240 px at 20 Hz. `error` is the
// largest position error of a submap's frames after its own Sim(3) alignment, RMSE in % of the
// distance that it travelled (of 0.1 m if that is more); a submap is wrong above 5 %.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "agent/agent.h"
#include "common/base/logging.h"
#include "common/trajectory/alignment.h"
#include "tests/synthetic/frame_renderer.h"
#include "tests/synthetic/mission.h"

namespace portolan {
namespace {

constexpr int kFrames = 200;
constexpr double kWrong_percent = 5;

struct TimedImage {
  Timestamp time{};
  cv::Mat gray;
};

struct Effect {
  const char* name;
  std::string mission = "loop";
  std::function<void(synthetic::MissionOptions*)> set = nullptr;
  std::function<void(synthetic::Mission*)> move = nullptr;
  std::function<void(std::vector<TimedImage>*)> spoil = nullptr;
};

struct Outcome {
  int frames = 0, tracked = 0, lost = 0;
  size_t submaps = 0;
  double worst_percent = 0;
};

double YawAt(const synthetic::Mission& mission, double time_s) {
  const Eigen::Matrix3d axes =
      mission.agents[0].path.At(time_s).world_from_body.rotation.toRotationMatrix();
  return std::atan2(axes(1, 0), axes(0, 0));
}

// Another path from the loop's place after 2 s: offset(t) in m along the view, to its left and up;
// turn(t) as yaw, pitch, roll.
void MoveAs(synthetic::Mission* mission, const std::function<Eigen::Vector3d(double)>& offset,
            const std::function<Eigen::Vector3d(double)>& turn) {
  const Eigen::Vector3d place = mission->agents[0].path.At(2).world_from_body.translation;
  const double yaw = YawAt(*mission, 2);
  const Eigen::Quaterniond world_from_heading = RotationExp({0, 0, yaw});
  constexpr double kInterval_s = 0.1;
  std::vector<synthetic::PathKnot> knots;
  for (int i = 0; i < 110; ++i) {
    const double t = std::max(0.0, kInterval_s * (i - 1));
    knots.push_back({place + world_from_heading * offset(t), Eigen::Vector3d(yaw, 0, 0) + turn(t)});
  }
  mission->agents[0].path = synthetic::BodyPath(knots, kInterval_s);
}

Eigen::Vector3d Sideways(double t) { return {0, 0.8 * std::sin(0.6 * t), 0.2 * std::sin(0.9 * t)}; }
Eigen::Vector3d NoTurn(double) { return Eigen::Vector3d::Zero(); }

// A man-sized textured thing that crosses the image every 4 s.
void WalkThrough(std::vector<TimedImage>* images) {
  cv::theRNG().state = 5;
  cv::Mat person(200, 70, CV_8UC1);
  cv::randu(person, 20, 220);
  cv::GaussianBlur(person, person, cv::Size(0, 0), 2);
  for (size_t i = 0; i < images->size(); ++i) {
    cv::Mat gray = (*images)[i].gray.clone();
    const int x = static_cast<int>(i % 80) * 6 - 70;
    const cv::Rect place = cv::Rect(x, 30, 70, 200) & cv::Rect(0, 0, gray.cols, gray.rows);
    if (place.area() > 0) {
      person(cv::Rect(place.x - x, 0, place.width, place.height)).copyTo(gray(place));
    }
    (*images)[i].gray = gray;
  }
}

void Scale(std::vector<TimedImage>* images, const std::function<double(size_t)>& gain) {
  for (size_t i = 0; i < images->size(); ++i) {
    cv::Mat scaled;
    (*images)[i].gray.convertTo(scaled, CV_8U, gain(i));
    (*images)[i].gray = scaled;
  }
}

void KeepOnly(std::vector<TimedImage>* images, const std::function<bool(size_t)>& keep) {
  std::vector<TimedImage> kept;
  for (size_t i = 0; i < images->size(); ++i) {
    if (keep(i)) kept.push_back((*images)[i]);
  }
  *images = std::move(kept);
}

std::vector<Effect> LightEffects() {
  return {
      {.name = "none"},
      {.name = "exposure swings by 60 % in 1 s",
       .set =
           [](auto* o) {
             o->effects.exposure_swing = 0.6;
             o->effects.exposure_period_s = 1;
           }},
      {.name = "exposure halves and doubles every second",
       .spoil = [](auto* i) { Scale(i, [](size_t n) { return n / 20 % 2 == 0 ? 1.0 : 0.5; }); }},
      {.name = "overexposed for 1 s (gain 3)",
       .spoil = [](auto* i) { Scale(i, [](size_t n) { return n >= 80 && n < 100 ? 3.0 : 1.0; }); }},
      {.name = "dark for 0.15 s",
       .spoil = [](auto* i) { Scale(i, [](size_t n) { return n >= 80 && n < 83 ? 0. : 1.; }); }},
      {.name = "dark for 1 s",
       .spoil = [](auto* i) { Scale(i, [](size_t n) { return n >= 80 && n < 100 ? 0. : 1.; }); }},
      {.name = "noise of 10 grey levels", .set = [](auto* o) { o->effects.noise_sigma = 10; }},
      {.name = "motion blur, shutter 25 ms", .set = [](auto* o) { o->effects.shutter_s = 0.025; }},
      {.name = "motion blur, shutter 50 ms", .set = [](auto* o) { o->effects.shutter_s = 0.05; }},
      {.name = "a person walks through", .spoil = WalkThrough},
  };
}

std::vector<Effect> MotionEffects() {
  const auto shaken = [](double degrees) {
    return [degrees](synthetic::Mission* m) {
      MoveAs(m, Sideways, [degrees](double t) {
        const double a = degrees * M_PI / 180;
        return Eigen::Vector3d(a * std::sin(4 * t), 0.5 * a * std::sin(5 * t), 0);
      });
    };
  };
  return {
      {.name = "fast rotation, up to 60 deg/s", .move = shaken(15)},
      {.name = "fast rotation, up to 160 deg/s", .move = shaken(40)},
      {.name = "forward driving",
       .move =
           [](auto* m) {
             MoveAs(
                 m, [](double t) { return Eigen::Vector3d(0.3 * t, 0, 0); }, NoTurn);
           }},
      {.name = "turns on the spot after a flight", .mission = "pure_rotation"},
      {.name = "pure rotation from the start",
       .move =
           [](auto* m) {
             MoveAs(m, NoTurn,
                    [](double t) { return Eigen::Vector3d(0.6 * std::sin(0.5 * t), 0, 0); });
           }},
      {.name = "bare walls", .mission = "low_texture"},
      {.name = "repeated texture", .mission = "repeated_texture"},
  };
}

std::vector<Effect> TimeEffects() {
  return {
      {.name = "every second frame dropped",
       .spoil = [](auto* i) { KeepOnly(i, [](size_t n) { return n % 2 == 0; }); }},
      {.name = "three of four frames dropped",
       .spoil = [](auto* i) { KeepOnly(i, [](size_t n) { return n % 4 == 0; }); }},
      {.name = "0.5 s without frames",
       .spoil = [](auto* i) { KeepOnly(i, [](size_t n) { return n < 80 || n >= 90; }); }},
      {.name = "1.5 s without frames",
       .spoil = [](auto* i) { KeepOnly(i, [](size_t n) { return n < 80 || n >= 110; }); }},
      {.name = "2.5 s without frames",
       .spoil = [](auto* i) { KeepOnly(i, [](size_t n) { return n < 80 || n >= 130; }); }},
      {.name = "every fourth image shown again",
       .spoil =
           [](auto* i) {
             for (size_t n = 3; n < i->size(); n += 4) (*i)[n].gray = (*i)[n - 1].gray;
           }},
      {.name = "picture frozen for 1 s, then it jumps",
       .spoil =
           [](auto* i) {
             for (size_t n = 80; n < 100; ++n) (*i)[n].gray = (*i)[79].gray;
           }},
  };
}

// RMSE of the submap's frames in % of its travelled distance.
double Error_percent(const Submap& submap, const synthetic::Mission& mission) {
  std::vector<Eigen::Vector3d> estimate, truth;
  double distance = 0;
  for (const FramePose& frame : submap.frames) {
    estimate.push_back(frame.submap_from_camera.translation);
    const double time_s = ToSeconds(frame.time - mission.FrameTime(0));
    truth.push_back(mission.WorldFromCamera(mission.agents[0], time_s).translation);
    if (truth.size() > 1) distance += (truth.back() - truth[truth.size() - 2]).norm();
  }
  const auto truth_from_submap = AlignPoints(estimate, truth, AlignmentMode::kSim3);
  if (!truth_from_submap) return 0;
  double sum = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    sum += (*truth_from_submap * estimate[i] - truth[i]).squaredNorm();
  }
  return 100 * std::sqrt(sum / static_cast<double>(truth.size())) / std::max(distance, 0.1);
}

StatusOr<Outcome> Measure(const Effect& effect) {
  synthetic::MissionOptions options;
  options.name = effect.mission;
  options.frames = kFrames;
  options.camera = synthetic::MissionOptions::SmallCamera();
  if (effect.set) effect.set(&options);
  PORTOLAN_ASSIGN_OR_RETURN(synthetic::Mission mission, synthetic::MakeMission(options));
  if (effect.move) effect.move(&mission);
  synthetic::FrameRenderer renderer(mission, 0);
  std::vector<TimedImage> images;
  for (int frame = 0; frame < kFrames; ++frame) {
    cv::Mat1b image;
    renderer.Render(frame, &image);
    images.push_back({mission.FrameTime(frame), image});
  }
  if (effect.spoil) effect.spoil(&images);
  PORTOLAN_ASSIGN_OR_RETURN(const CameraModel camera, CameraModel::Create(options.camera));
  PORTOLAN_ASSIGN_OR_RETURN(const auto agent,
                            Agent::Create({}, camera, AgentId("effects"), SessionId(1)));
  Outcome outcome;
  const auto take = [&](const Submap& submap) {
    ++outcome.submaps;
    outcome.worst_percent = std::max(outcome.worst_percent, Error_percent(submap, mission));
  };
  for (const TimedImage& image : images) {
    PORTOLAN_ASSIGN_OR_RETURN(const FrameResult result,
                              agent->ProcessImage(image.time, image.gray));
    ++outcome.frames;
    outcome.tracked += result.tracked ? 1 : 0;
    outcome.lost += result.tracking_failed ? 1 : 0;
    if (result.closed_submap) take(*result.closed_submap);
  }
  if (const auto last = agent->Finish()) take(*last);
  return outcome;
}

const char* Verdict(const Outcome& outcome) {
  if (outcome.worst_percent > kWrong_percent) return "wrong";
  if (outcome.lost > 0) return "closed";
  return "survived";
}

Status Run() {
  std::printf("%-42s %6s %8s %5s %8s %8s  %s\n", "effect", "frames", "tracked", "lost", "submaps",
              "error %", "outcome");
  for (const auto& effects : {LightEffects(), MotionEffects(), TimeEffects()}) {
    for (const Effect& effect : effects) {
      PORTOLAN_ASSIGN_OR_RETURN(const Outcome o, Measure(effect));
      std::printf("%-42s %6d %8d %5d %8zu %8.2f  %s\n", effect.name, o.frames, o.tracked, o.lost,
                  o.submaps, o.worst_percent, Verdict(o));
      std::fflush(stdout);
    }
  }
  return absl::OkStatus();
}

}  // namespace
}  // namespace portolan

int main() {
  cv::setNumThreads(1);
  portolan::SetLogLevel(portolan::LogLevel::kError);
  const portolan::Status status = portolan::Run();
  if (status.ok()) return 0;
  std::fprintf(stderr, "error: %s\n", std::string(status.message()).c_str());
  return 1;
}
