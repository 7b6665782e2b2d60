#include "tests/agent/local_adjustment/moving_camera.h"

#include <cmath>
#include <random>

#include "tests/support/test_cameras.h"

namespace portolan {

MovingCamera::MovingCamera() : camera_(PinholeTestCamera()) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> x(-4, 16), y(-2.5, 2.5), z(3, 6);
  for (int i = 0; i < 700; ++i) {
    const double along = x(random), up = y(random), away = z(random);
    points_.emplace_back(along, up, away);
  }
}

Rigid3 MovingCamera::WorldFromCamera(int frame) {
  const double s = 0.03 * frame;
  return {RotationExp({0.1 * std::sin(0.7 * s), 0.15 * std::sin(s), 0.05 * s}),
          {s, 0.2 * std::sin(2 * s), 0.3 * std::sin(1.3 * s)}};
}

std::vector<LiveSight> MovingCamera::Sights(int frame) const {
  const Rigid3 camera_from_world = WorldFromCamera(frame).Inverse();
  std::vector<LiveSight> sights;
  for (size_t i = 0; i < points_.size(); ++i) {
    const auto pixel = camera_.Project(camera_from_world * points_[i]);
    if (!pixel || !camera_.IsInImage(*pixel)) continue;
    sights.push_back({{TrackId(static_cast<uint32_t>(i)), pixel->cast<float>(), 0.5f}, i % 4 == 0});
  }
  return sights;
}

std::vector<Feature> MovingCamera::Features(int frame) const {
  std::vector<Feature> features;
  for (const LiveSight& sight : Sights(frame)) {
    const TrackId track = sight.observation.track;
    features.push_back({sight.observation.pixel, 0, track, DescriptorOf(track)});
  }
  return features;
}

Descriptor MovingCamera::DescriptorOf(TrackId track) {
  std::mt19937_64 random(track.value());
  Descriptor descriptor;
  for (uint64_t& word : descriptor.words) word = random();
  return descriptor;
}

Rigid3 DriftingOdometry::Next(int frame) {
  if (frame == 0) return odometry_from_camera_;
  Rigid3 motion =
      MovingCamera::WorldFromCamera(frame - 1).Inverse() * MovingCamera::WorldFromCamera(frame);
  motion.translation *= scale_;
  scale_ *= 1 - drift_;
  odometry_from_camera_ = odometry_from_camera_ * motion;
  return odometry_from_camera_;
}

}  // namespace portolan
