// A world of textured rectangles: a hall with crates and pillars.
#ifndef PORTOLAN_TESTS_SYNTHETIC_WORLD_H_
#define PORTOLAN_TESTS_SYNTHETIC_WORLD_H_

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <vector>

#include "tests/synthetic/texture.h"

namespace portolan::synthetic {

// A rectangle, seen only from the side where v is down when u is to the right (that v x u points
// to), so that writing on its texture reads. Metres, world frame (z up).
struct Surface {
  Eigen::Vector3d corner = Eigen::Vector3d::Zero();
  Eigen::Vector3d u = Eigen::Vector3d::UnitX();  // unit vectors along the sides
  Eigen::Vector3d v = Eigen::Vector3d::UnitY();
  double width_m = 1, height_m = 1;  // along u, v
  std::shared_ptr<const Texture> texture;
  // Where on the texture the corner lies, and how bright the surface is lit.
  Eigen::Vector2d texture_offset_m = Eigen::Vector2d::Zero();
  double brightness = 1.0;
};

struct World {
  std::vector<Surface> surfaces;
  double background = 190;  // grey where nothing is hit
};

struct WorldOptions {
  uint64_t seed = 1;
  // The hall spans [-length/2, length/2] x [-width/2, width/2] x [0, height].
  double length_m = 10, width_m = 8, height_m = 3.2;
  int wall_crates = 16;
  int centre_crates = 7;
  // Factor on the contrast of the noise and the number of shapes; 0.15 makes bare walls.
  double texture_amount = 1.0;
  // One tile of about a metre for all walls and the floor, one texture for all crates.
  bool repeated_texture = false;
};

World MakeHall(const WorldOptions& options);

// A box that stands on the floor, turned by yaw_rad.
struct Box {
  Eigen::Vector3d base_centre = Eigen::Vector3d::Zero();
  Eigen::Vector3d size_m = Eigen::Vector3d::Ones();
  double yaw_rad = 0;
};
// Adds its four sides and its top, textured in turn.
void AddBox(const Box& box, const std::vector<std::shared_ptr<const Texture>>& textures,
            World* world);

}  // namespace portolan::synthetic

#endif  // PORTOLAN_TESTS_SYNTHETIC_WORLD_H_
