// A town for the replay of large fleets: streets in a square grid, house fronts with points. What a
// camera sees is computed, nothing is rendered.
#ifndef PORTOLAN_TESTS_SUPPORT_REPLAY_WORLD_H_
#define PORTOLAN_TESTS_SUPPORT_REPLAY_WORLD_H_

#include <cstdint>
#include <random>
#include <vector>

#include "common/camera/camera_model.h"
#include "common/features/descriptor.h"
#include "common/geometry/rigid3.h"

namespace portolan {

struct ReplayWorldOptions {
  uint64_t seed = 1;
  // Blocks of houses along each side; streets run around every block.
  int blocks = 4;
  double street_spacing_m = 40;
  double street_width_m = 12;
  double front_height_m = 7;
  double points_per_m2 = 3.5;
  double relief_m = 0.8;  // points stand out of their front by up to this
  // Farther points are too small to be tracked.
  double max_range_m = 22;
  int flipped_bits = 8;  // noise of a described feature
};

// Immutable after construction, thread-safe. World frame: x, y along the streets, z up, metres.
class ReplayWorld {
 public:
  explicit ReplayWorld(const ReplayWorldOptions& options);

  struct Sight {
    int point = 0;
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  };
  // Points in the image that no house hides, ascending.
  std::vector<Sight> Visible(const CameraModel& camera, const Rigid3& world_from_camera) const;

  // The descriptor of a point seen from a place: half of its bits depend on the direction of the
  // view, so that a fifth of a right angle changes 14 bits; on top come `flipped_bits` random ones.
  Descriptor Describe(int point, const Eigen::Vector3d& from_in_world,
                      std::mt19937_64* random) const;

  const Eigen::Vector3d& position(int point) const { return points_[point].position; }
  int point_count() const { return static_cast<int>(points_.size()); }
  const ReplayWorldOptions& options() const { return options_; }

 private:
  struct Point {
    Eigen::Vector3d position;
    Descriptor descriptor;
  };
  // One side of a block of houses.
  struct Front {
    Eigen::Vector2d normal;  // outwards, unit
    Eigen::Vector2d middle;
    int first_point = 0;
    int end_point = 0;
  };

  void AddFront(const Eigen::Vector2d& middle, const Eigen::Vector2d& normal, double length,
                std::mt19937_64* random);
  bool IsHidden(const Eigen::Vector2d& camera, const Eigen::Vector2d& point) const;

  const ReplayWorldOptions options_;
  std::vector<Point> points_;
  std::vector<Front> fronts_;
};

}  // namespace portolan

#endif  // PORTOLAN_TESTS_SUPPORT_REPLAY_WORLD_H_
