// A camera that looks to and fro over a wide arc of points, which stay in the filter when they are
// out of view: for what deals with landmarks out of view.
#ifndef PORTOLAN_TESTS_AGENT_FILTER_TURNING_WORLD_H_
#define PORTOLAN_TESTS_AGENT_FILTER_TURNING_WORLD_H_

#include <random>
#include <vector>

#include "agent/filter/local_filter.h"
#include "tests/agent/filter/point_world.h"

namespace portolan {

// Repeatable. Each frame has its measurements whatever the filter does, so that several filters can
// be given the same ones.
class TurningWorld {
 public:
  // half_arc_rad: how far to both sides of the start the points are and the camera turns.
  TurningWorld(int points, double half_arc_rad, double period_s)
      : camera_(MakeTestCamera()), half_arc_(half_arc_rad), period_s_(period_s) {
    std::uniform_real_distribution<double> uniform(-1, 1);
    for (int i = 0; i < points; ++i) {
      const double angle = (half_arc_rad + 0.4) * uniform(random_);
      const double distance = 3.0 + uniform(random_), height = uniform(random_);
      points_.emplace_back(distance * std::sin(angle), height, distance * std::cos(angle));
    }
  }

  const CameraModel& camera() const { return camera_; }
  Timestamp TimeOf(int frame) const { return FromSeconds(frame / 30.0); }
  Rigid3 PoseAt(int frame) const {
    const double phase = 2 * 3.14159265358979 * frame / (30.0 * period_s_);
    return {RotationExp({0, half_arc_ * std::sin(phase), 0}),
            Eigen::Vector3d(0.6 * std::sin(2 * phase), 0.1 * std::sin(3 * phase),
                            0.2 * (1 - std::cos(phase)))};
  }
  std::vector<Measurement> Measure(int frame) {
    random_.seed(1000 + static_cast<uint64_t>(frame));
    std::normal_distribution<double> noise(0, 0.5);
    std::vector<Measurement> seen;
    for (size_t i = 0; i < points_.size(); ++i) {
      const auto pixel = camera_.Project(PoseAt(frame).Inverse() * points_[i]);
      const double x = noise(random_), y = noise(random_);
      if (!pixel || !camera_.IsInImage(*pixel, 5)) continue;
      seen.push_back({TrackId(static_cast<uint32_t>(i)), *pixel + Eigen::Vector2d(x, y), 0.5});
    }
    return seen;
  }
  // Frame 0 starts the filter; all points become landmarks when they are first seen.
  void Step(int frame, LocalFilter* filter) {
    if (frame == 0) {
      filter->Start(TimeOf(0));
    } else {
      filter->Predict(TimeOf(frame));
      std::vector<Measurement> known = Measure(frame);
      std::erase_if(known, [&](const Measurement& m) { return !filter->HasLandmark(m.track); });
      filter->Update(known);
    }
    std::vector<Measurement> unknown = Measure(frame);
    std::erase_if(unknown, [&](const Measurement& m) { return filter->HasLandmark(m.track); });
    if (!unknown.empty()) filter->AddLandmarks(unknown);
  }

 private:
  const CameraModel camera_;
  const double half_arc_;
  const double period_s_;
  std::mt19937_64 random_{17};
  std::vector<Eigen::Vector3d> points_;
};

}  // namespace portolan

#endif  // PORTOLAN_TESTS_AGENT_FILTER_TURNING_WORLD_H_
