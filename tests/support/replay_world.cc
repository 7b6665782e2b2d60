#include "tests/support/replay_world.h"

#include <algorithm>
#include <cmath>

namespace portolan {
namespace {

// Uniform in [0, 1) from a hash (SplitMix64).
double HashedUniform(uint64_t value) {
  value += 0x9e3779b97f4a7c15;
  value = (value ^ (value >> 30)) * 0xbf58476d1ce4e5b9;
  value = (value ^ (value >> 27)) * 0x94d049bb133111eb;
  return static_cast<double>((value ^ (value >> 31)) >> 11) * 0x1.0p-53;
}

double Uniform(double low, double high, std::mt19937_64* random) {
  return std::uniform_real_distribution<double>(low, high)(*random);
}

// True if the segment passes through the inside of the square about `middle`.
bool CrossesSquare(const Eigen::Vector2d& from, const Eigen::Vector2d& to,
                   const Eigen::Vector2d& middle, double half_side) {
  double begin = 0;
  double end = 1;
  for (int axis = 0; axis < 2; ++axis) {
    const double step = to[axis] - from[axis];
    const double low = middle[axis] - half_side - from[axis];
    const double high = middle[axis] + half_side - from[axis];
    if (std::abs(step) < 1e-9) {
      if (low > 0 || high < 0) return false;
      continue;
    }
    begin = std::max(begin, std::min(low / step, high / step));
    end = std::min(end, std::max(low / step, high / step));
  }
  return begin < end;
}

}  // namespace

ReplayWorld::ReplayWorld(const ReplayWorldOptions& options) : options_(options) {
  std::mt19937_64 random(options.seed);
  const double length = options.street_spacing_m - options.street_width_m;
  for (int i = -1; i <= options.blocks; ++i) {
    for (int j = -1; j <= options.blocks; ++j) {
      const Eigen::Vector2d middle((i + 0.5) * options.street_spacing_m,
                                   (j + 0.5) * options.street_spacing_m);
      for (const Eigen::Vector2d& normal : {Eigen::Vector2d(1, 0), Eigen::Vector2d(-1, 0),
                                            Eigen::Vector2d(0, 1), Eigen::Vector2d(0, -1)}) {
        AddFront(middle + 0.5 * length * normal, normal, length, &random);
      }
    }
  }
}

void ReplayWorld::AddFront(const Eigen::Vector2d& middle, const Eigen::Vector2d& normal,
                           double length, std::mt19937_64* random) {
  Front front{normal, middle, point_count(), 0};
  const int count = static_cast<int>(length * options_.front_height_m * options_.points_per_m2);
  const Eigen::Vector2d along(-normal.y(), normal.x());
  for (int i = 0; i < count; ++i) {
    Point point;
    const Eigen::Vector2d foot = middle + Uniform(-0.5, 0.5, random) * length * along +
                                 Uniform(0.01, options_.relief_m, random) * normal;
    point.position << foot, Uniform(0, options_.front_height_m, random);
    for (uint64_t& word : point.descriptor.words) word = (*random)();
    points_.push_back(point);
  }
  front.end_point = point_count();
  fronts_.push_back(front);
}

bool ReplayWorld::IsHidden(const Eigen::Vector2d& camera, const Eigen::Vector2d& point) const {
  const double spacing = options_.street_spacing_m;
  const double half_side = 0.5 * (spacing - options_.street_width_m);
  const Eigen::Vector2d low = camera.cwiseMin(point) / spacing;
  const Eigen::Vector2d high = camera.cwiseMax(point) / spacing;
  for (int i = static_cast<int>(std::floor(low.x())); i <= std::floor(high.x()); ++i) {
    for (int j = static_cast<int>(std::floor(low.y())); j <= std::floor(high.y()); ++j) {
      const Eigen::Vector2d middle((i + 0.5) * spacing, (j + 0.5) * spacing);
      if (CrossesSquare(camera, point, middle, half_side)) return true;
    }
  }
  return false;
}

std::vector<ReplayWorld::Sight> ReplayWorld::Visible(const CameraModel& camera,
                                                     const Rigid3& world_from_camera) const {
  const Eigen::Vector3d& position = world_from_camera.translation;
  const Rigid3 camera_from_world = world_from_camera.Inverse();
  const Eigen::Vector3d forward = world_from_camera.rotation * Eigen::Vector3d::UnitZ();
  const double reach = options_.max_range_m + 0.5 * options_.street_spacing_m;
  std::vector<Sight> sights;
  for (const Front& front : fronts_) {
    const Eigen::Vector2d offset = position.head<2>() - front.middle;
    if (offset.norm() > reach || offset.dot(front.normal) < 1) continue;
    for (int i = front.first_point; i < front.end_point; ++i) {
      const Eigen::Vector3d ray = points_[i].position - position;
      const double distance = ray.norm();
      // The corner of the image is 40 degrees off its axis.
      if (distance > options_.max_range_m || ray.dot(forward) < 0.72 * distance) continue;
      const auto pixel = camera.Project(camera_from_world * points_[i].position);
      if (!pixel || !camera.IsInImage(*pixel, 2)) continue;
      if (!IsHidden(position.head<2>(), points_[i].position.head<2>())) {
        sights.push_back({i, *pixel});
      }
    }
  }
  return sights;
}

Descriptor ReplayWorld::Describe(int point, const Eigen::Vector3d& from_in_world,
                                 std::mt19937_64* random) const {
  Descriptor descriptor = points_[point].descriptor;
  const Eigen::Vector3d ray = from_in_world - points_[point].position;
  const double azimuth = std::atan2(ray.y(), ray.x());
  for (uint64_t bit = 0; bit < 128; ++bit) {
    // Each of these bits is set while the view comes from one half of the circle.
    const double start = 2 * M_PI * HashedUniform(static_cast<uint64_t>(point) * 128 + bit);
    if (std::sin(azimuth - start) > 0) {
      descriptor.words[bit / 64] ^= uint64_t{1} << (bit % 64);
    }
  }
  for (int i = 0; i < options_.flipped_bits; ++i) {
    const uint64_t bit = (*random)() % 256;
    descriptor.words[bit / 64] ^= uint64_t{1} << (bit % 64);
  }
  return descriptor;
}

}  // namespace portolan
