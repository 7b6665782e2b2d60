#include "tests/synthetic/world.h"

#include <algorithm>
#include <cmath>

#include "tests/synthetic/random.h"

namespace portolan::synthetic {
namespace {

using Eigen::Vector3d;

// Light from above and from one side.
double Brightness(const Vector3d& normal) {
  const Vector3d light = Vector3d(0.35, 0.6, 0.75).normalized();
  return 0.82 + 0.24 * normal.dot(light);
}

// Makes the textures of a world: own ones, or one for all where they repeat.
class TextureShop {
 public:
  explicit TextureShop(const WorldOptions& options) : options_(options), random_(options.seed) {}

  std::shared_ptr<const Texture> Make(double width_m, double height_m, double texel_m) {
    if (options_.repeated_texture && tile_) return tile_;
    TextureOptions texture;
    texture.seed = random_.Next();
    texture.width_m = options_.repeated_texture ? 1.0 : width_m;
    texture.height_m = options_.repeated_texture ? 1.0 : height_m;
    texture.texel_m = options_.repeated_texture ? 0.004 : texel_m;
    texture.noise_contrast *= options_.texture_amount;
    texture.shapes_per_m2 *= options_.texture_amount;
    texture.repeated = options_.repeated_texture;
    auto made = std::make_shared<const Texture>(MakeTexture(texture));
    if (options_.repeated_texture) tile_ = made;
    return made;
  }

 private:
  const WorldOptions& options_;
  Random random_;
  std::shared_ptr<const Texture> tile_;
};

void AddRectangle(const Vector3d& corner, const Vector3d& u_side, const Vector3d& v_side,
                  double texel_m, TextureShop* shop, World* world) {
  Surface surface;
  surface.corner = corner;
  surface.width_m = u_side.norm();
  surface.height_m = v_side.norm();
  surface.u = u_side.normalized();
  surface.v = v_side.normalized();
  surface.texture = shop->Make(surface.width_m, surface.height_m, texel_m);
  surface.brightness = Brightness(surface.v.cross(surface.u));
  world->surfaces.push_back(surface);
}

void AddRoom(const WorldOptions& options, TextureShop* shop, World* world) {
  const double l = options.length_m, w = options.width_m, h = options.height_m;
  const Vector3d x = Vector3d::UnitX() * l, y = Vector3d::UnitY() * w, z = Vector3d::UnitZ() * h;
  const Vector3d low(-l / 2, -w / 2, 0), high(l / 2, w / 2, h);
  AddRectangle(low, y, x, 0.005, shop, world);            // floor
  AddRectangle(low + z, x, y, 0.008, shop, world);        // ceiling
  AddRectangle(low + x + z, -x, -z, 0.004, shop, world);  // the wall at the least y
  AddRectangle(high - x, x, -z, 0.004, shop, world);      // at the largest y
  AddRectangle(low + z, y, -z, 0.004, shop, world);       // at the least x
  AddRectangle(high, -y, -z, 0.004, shop, world);         // at the largest x
}

Box RandomBox(const Vector3d& base_centre, double largest_height_m, Random* random) {
  Box box;
  box.base_centre = base_centre;
  box.size_m = {random->Uniform(0.35, 0.9), random->Uniform(0.35, 0.9),
                random->Uniform(0.4, largest_height_m)};
  box.yaw_rad = random->Uniform(0, M_PI);
  return box;
}

std::vector<Box> PlaceBoxes(const WorldOptions& options, Random* random) {
  std::vector<Box> boxes;
  for (int i = 0; i < options.wall_crates; ++i) {
    // Along the walls, in turn round the hall, so that every view has something near.
    const double angle = 2 * M_PI * (i + random->Uniform(0.2, 0.8)) / options.wall_crates;
    const double reach = 1.0 / std::max(std::abs(std::cos(angle)) / (options.length_m / 2 - 0.6),
                                        std::abs(std::sin(angle)) / (options.width_m / 2 - 0.6));
    const Vector3d place(reach * std::cos(angle), reach * std::sin(angle), 0);
    boxes.push_back(RandomBox(place, 2.2, random));
  }
  for (int i = 0; i < options.centre_crates; ++i) {
    const double angle = 2 * M_PI * i / options.centre_crates;
    const double radius = i == 0 ? 0.0 : random->Uniform(0.45, 0.95);
    boxes.push_back(
        RandomBox({radius * std::cos(angle), radius * std::sin(angle), 0}, 1.5, random));
  }
  return boxes;
}

}  // namespace

void AddBox(const Box& box, const std::vector<std::shared_ptr<const Texture>>& textures,
            World* world) {
  const Vector3d x(std::cos(box.yaw_rad), std::sin(box.yaw_rad), 0);
  const Vector3d y(-x.y(), x.x(), 0);
  const Vector3d z = Vector3d::UnitZ();
  const Vector3d half = 0.5 * box.size_m;
  const double h = box.size_m.z();
  const auto at = [&](double sx, double sy, double up) -> Vector3d {
    return box.base_centre + sx * half.x() * x + sy * half.y() * y + up * z;
  };
  // Sides start at their upper left corner, seen from outside.
  const double width = box.size_m.x(), depth = box.size_m.y();
  const Surface sides[] = {{at(-1, -1, h), x, -z, width, h, nullptr, {0, 0}, 1},
                           {at(1, 1, h), -x, -z, width, h, nullptr, {0, 0}, 1},
                           {at(1, -1, h), y, -z, depth, h, nullptr, {0, 0}, 1},
                           {at(-1, 1, h), -y, -z, depth, h, nullptr, {0, 0}, 1},
                           {at(-1, -1, h), y, x, depth, width, nullptr, {0, 0}, 1}};
  size_t next = 0;
  for (Surface side : sides) {
    side.texture = textures[next++ % textures.size()];
    side.brightness = Brightness(side.v.cross(side.u));
    world->surfaces.push_back(side);
  }
}

World MakeHall(const WorldOptions& options) {
  World world;
  TextureShop shop(options);
  AddRoom(options, &shop, &world);
  Random random(options.seed + 0x517cc1b727220a95ULL);
  for (const Box& box : PlaceBoxes(options, &random)) {
    const double width = std::max(box.size_m.x(), box.size_m.y());
    const double height = box.size_m.z();
    std::vector<std::shared_ptr<const Texture>> textures;
    for (int i = 0; i < 4; ++i) textures.push_back(shop.Make(width, height, 0.003));
    textures.push_back(shop.Make(width, width, 0.003));
    AddBox(box, textures, &world);
  }
  return world;
}

}  // namespace portolan::synthetic
