#include "tests/synthetic/renderer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace portolan::synthetic {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr int kTileSize = 16;
constexpr double kNearPlane_m = 0.02;
constexpr float kInfinity = std::numeric_limits<float>::infinity();

// Corners of the surface in front of the near plane (Sutherland & Hodgman 1974), normalised.
std::vector<Vector2f> ClippedOutline(const std::array<Vector3d, 4>& corners_in_camera) {
  std::vector<Vector2f> outline;
  const auto add = [&](const Vector3d& p) {
    outline.emplace_back(static_cast<float>(p.x() / p.z()), static_cast<float>(p.y() / p.z()));
  };
  for (size_t i = 0; i < 4; ++i) {
    const Vector3d& a = corners_in_camera[i];
    const Vector3d& b = corners_in_camera[(i + 1) % 4];
    const bool a_in = a.z() > kNearPlane_m, b_in = b.z() > kNearPlane_m;
    if (a_in) add(a);
    if (a_in != b_in) add(a + (b - a) * ((kNearPlane_m - a.z()) / (b.z() - a.z())));
  }
  return outline;
}

}  // namespace

Renderer::Renderer(const CameraModel& camera, const World& world) : world_(world) {
  BuildRays(camera);
  BuildTiles();
  inverse_depth_.create(ray_x_.size());
  view_of_pixel_.create(ray_x_.size());
}

void Renderer::BuildRays(const CameraModel& camera) {
  ray_x_.create(camera.height_px(), camera.width_px());
  ray_y_.create(camera.height_px(), camera.width_px());
  for (int y = 0; y < ray_x_.rows; ++y) {
    for (int x = 0; x < ray_x_.cols; ++x) {
      const auto ray = camera.Unproject({x, y});
      const bool is_usable = ray && ray->z() > 0.02;
      ray_x_(y, x) = is_usable ? static_cast<float>(ray->x() / ray->z()) : std::nanf("");
      ray_y_(y, x) = is_usable ? static_cast<float>(ray->y() / ray->z()) : std::nanf("");
    }
  }
}

void Renderer::BuildTiles() {
  const cv::Rect image(0, 0, ray_x_.cols, ray_x_.rows);
  for (int y = 0; y < image.height; y += kTileSize) {
    for (int x = 0; x < image.width; x += kTileSize) {
      Tile tile{cv::Rect(x, y, kTileSize, kTileSize) & image, kInfinity, -kInfinity, kInfinity,
                -kInfinity};
      for (int row = tile.pixels.y; row < tile.pixels.br().y; ++row) {
        for (int column = x; column < tile.pixels.br().x; ++column) {
          const float ray_x = ray_x_(row, column), ray_y = ray_y_(row, column);
          if (std::isnan(ray_x)) continue;
          tile.x_min = std::min(tile.x_min, ray_x), tile.x_max = std::max(tile.x_max, ray_x);
          tile.y_min = std::min(tile.y_min, ray_y), tile.y_max = std::max(tile.y_max, ray_y);
        }
      }
      if (tile.x_min <= tile.x_max) tiles_.push_back(tile);
    }
  }
}

void Renderer::BuildViews(const Rigid3& world_from_camera) {
  views_.clear();
  const Rigid3 camera_from_world = world_from_camera.Inverse();
  for (const Surface& surface : world_.surfaces) {
    const Vector3d corner = camera_from_world * surface.corner;
    const Vector3d u = camera_from_world.rotation * surface.u;
    const Vector3d v = camera_from_world.rotation * surface.v;
    const Vector3d normal = v.cross(u);
    const double distance = normal.dot(corner);
    if (distance > -1e-6) continue;  // seen from behind
    View view;
    view.outline = ClippedOutline({corner, corner + surface.width_m * u,
                                   corner + surface.width_m * u + surface.height_m * v,
                                   corner + surface.height_m * v});
    if (view.outline.empty()) continue;
    view.n = (normal / distance).cast<float>();
    view.u = u.cast<float>();
    view.v = v.cast<float>();
    view.u_offset = static_cast<float>(u.dot(corner));
    view.v_offset = static_cast<float>(v.dot(corner));
    view.width_m = static_cast<float>(surface.width_m);
    view.height_m = static_cast<float>(surface.height_m);
    view.surface = &surface;
    view.x_min = view.y_min = kInfinity;
    view.x_max = view.y_max = -kInfinity;
    for (const Vector2f& point : view.outline) {
      view.x_min = std::min(view.x_min, point.x()), view.x_max = std::max(view.x_max, point.x());
      view.y_min = std::min(view.y_min, point.y()), view.y_max = std::max(view.y_max, point.y());
    }
    views_.push_back(std::move(view));
  }
}

// Separating axes: those of the image and the outline's own edges.
bool Renderer::Overlaps(const View& view, const Tile& tile) {
  if (view.x_max < tile.x_min || view.x_min > tile.x_max || view.y_max < tile.y_min ||
      view.y_min > tile.y_max) {
    return false;
  }
  const Vector2f corners[] = {{tile.x_min, tile.y_min},
                              {tile.x_max, tile.y_min},
                              {tile.x_max, tile.y_max},
                              {tile.x_min, tile.y_max}};
  const size_t size = view.outline.size();
  for (size_t i = 0; i < size; ++i) {
    const Vector2f& a = view.outline[i];
    const Vector2f side = view.outline[(i + 1) % size] - a;
    // v x u points towards the camera, which looks along +z, so the inside has a positive cross
    // product.
    const bool all_outside = std::all_of(std::begin(corners), std::end(corners), [&](auto& c) {
      return side.x() * (c.y() - a.y()) - side.y() * (c.x() - a.x()) < 0;
    });
    if (all_outside) return false;
  }
  return true;
}

void Renderer::DrawDepth(int view_index, const Tile& tile) {
  const View& view = views_[view_index];
  for (int y = tile.pixels.y; y < tile.pixels.br().y; ++y) {
    const float* ray_x = ray_x_[y];
    const float* ray_y = ray_y_[y];
    float* inverse_depth = inverse_depth_[y];
    int16_t* view_of_pixel = view_of_pixel_[y];
    for (int x = tile.pixels.x; x < tile.pixels.br().x; ++x) {
      const float w = view.n.x() * ray_x[x] + view.n.y() * ray_y[x] + view.n.z();
      if (!(w > inverse_depth[x])) continue;
      const float u = view.u.x() * ray_x[x] + view.u.y() * ray_y[x] + view.u.z();
      const float v = view.v.x() * ray_x[x] + view.v.y() * ray_y[x] + view.v.z();
      const float u_m = u / w - view.u_offset, v_m = v / w - view.v_offset;
      if (u_m < 0 || v_m < 0 || u_m > view.width_m || v_m > view.height_m) continue;
      inverse_depth[x] = w;
      view_of_pixel[x] = static_cast<int16_t>(view_index);
    }
  }
}

float Renderer::ShadeRay(const View& view, const Vector3f& ray, const Vector3f& ray_dx,
                         const Vector3f& ray_dy) {
  const float depth = 1.0f / view.n.dot(ray);
  const float u = view.u.dot(ray) * depth, v = view.v.dot(ray) * depth;
  // d(u / w) = (du - (u / w) dw) / w, for one pixel in x and in y.
  const float w_dx = view.n.dot(ray_dx), w_dy = view.n.dot(ray_dy);
  Vector2f along(view.u.dot(ray_dx) - u * w_dx, view.v.dot(ray_dx) - v * w_dx);
  Vector2f across(view.u.dot(ray_dy) - u * w_dy, view.v.dot(ray_dy) - v * w_dy);
  along *= depth, across *= depth;
  if (along.squaredNorm() < across.squaredNorm()) std::swap(along, across);
  const float longer = along.norm(), shorter = across.norm();
  const float footprint = std::max(shorter, 0.25f * longer);
  const Surface& surface = *view.surface;
  const float u_m = u - view.u_offset + static_cast<float>(surface.texture_offset_m.x());
  const float v_m = v - view.v_offset + static_cast<float>(surface.texture_offset_m.y());
  if (!std::isfinite(longer)) {  // at the rim of the rays: no neighbour
    return static_cast<float>(surface.brightness) *
           surface.texture->Sample(u_m, v_m, surface.texture->texel_m());
  }
  const int samples = std::clamp(static_cast<int>(longer / footprint + 0.5f), 1, 4);
  float sum = 0;
  for (int i = 0; i < samples; ++i) {
    const float offset = (static_cast<float>(i) + 0.5f) / static_cast<float>(samples) - 0.5f;
    sum += surface.texture->Sample(u_m + offset * along.x(), v_m + offset * along.y(), footprint);
  }
  return static_cast<float>(surface.brightness) * sum / static_cast<float>(samples);
}

bool Renderer::IsEdge(int x, int y) const {
  const int16_t here = view_of_pixel_(y, x);
  return view_of_pixel_(y, x - 1) != here || view_of_pixel_(y, x + 1) != here ||
         view_of_pixel_(y - 1, x) != here || view_of_pixel_(y + 1, x) != here;
}

float Renderer::ShadeEdge(int x, int y) const {
  const Vector3f ray(ray_x_(y, x), ray_y_(y, x), 1);
  const Vector3f dx(ray_x_(y, x + 1) - ray.x(), ray_y_(y, x + 1) - ray.y(), 0);
  const Vector3f dy(ray_x_(y + 1, x) - ray.x(), ray_y_(y + 1, x) - ray.y(), 0);
  float sum = 0;
  for (const auto& [share_x, share_y] :
       {std::pair{-0.25f, -0.25f}, {0.25f, -0.25f}, {-0.25f, 0.25f}, {0.25f, 0.25f}}) {
    const Vector3f sub_ray = ray + share_x * dx + share_y * dy;
    const View* nearest = nullptr;
    float nearest_w = 0;
    for (int neighbour = 0; neighbour < 9; ++neighbour) {
      const int index = view_of_pixel_(y + neighbour / 3 - 1, x + neighbour % 3 - 1);
      if (index < 0 || &views_[index] == nearest) continue;
      const View& view = views_[index];
      const float w = view.n.dot(sub_ray);
      const float u_m = view.u.dot(sub_ray) / w - view.u_offset;
      const float v_m = view.v.dot(sub_ray) / w - view.v_offset;
      if (!(w > nearest_w) || u_m < 0 || v_m < 0 || u_m > view.width_m || v_m > view.height_m) {
        continue;
      }
      nearest = &view;
      nearest_w = w;
    }
    sum += nearest == nullptr ? static_cast<float>(world_.background)
                              : ShadeRay(*nearest, sub_ray, 0.5f * dx, 0.5f * dy);
  }
  return 0.25f * sum;
}

void Renderer::Shade(cv::Mat1f* image) const {
  const int columns = ray_x_.cols, rows = ray_x_.rows;
  for (int y = 0; y < rows; ++y) {
    const int y_next = y + 1 < rows ? y + 1 : y - 1;
    const float y_sign = y + 1 < rows ? 1.0f : -1.0f;
    const bool inside_row = y > 0 && y + 1 < rows;
    for (int x = 0; x < columns; ++x) {
      float& grey = (*image)(y, x);
      if (inside_row && x > 0 && x + 1 < columns && IsEdge(x, y)) {
        grey = ShadeEdge(x, y);
        continue;
      }
      const int index = view_of_pixel_(y, x);
      if (index < 0) {
        grey = static_cast<float>(world_.background);
        continue;
      }
      const int x_next = x + 1 < columns ? x + 1 : x - 1;
      const float x_sign = x + 1 < columns ? 1.0f : -1.0f;
      const Vector3f ray(ray_x_(y, x), ray_y_(y, x), 1);
      const Vector3f dx(x_sign * (ray_x_(y, x_next) - ray.x()),
                        x_sign * (ray_y_(y, x_next) - ray.y()), 0);
      const Vector3f dy(y_sign * (ray_x_(y_next, x) - ray.x()),
                        y_sign * (ray_y_(y_next, x) - ray.y()), 0);
      grey = ShadeRay(views_[index], ray, dx, dy);
    }
  }
}

void Renderer::Render(const Rigid3& world_from_camera, cv::Mat1f* image) {
  BuildViews(world_from_camera);
  inverse_depth_.setTo(0);
  view_of_pixel_.setTo(-1);
  for (size_t i = 0; i < views_.size(); ++i) {
    for (const Tile& tile : tiles_) {
      if (Overlaps(views_[i], tile)) DrawDepth(static_cast<int>(i), tile);
    }
  }
  image->create(ray_x_.size());
  Shade(image);
}

cv::Mat1f Renderer::Depth() const {
  cv::Mat1f depth(inverse_depth_.size(), 0.0f);
  for (int y = 0; y < depth.rows; ++y) {
    for (int x = 0; x < depth.cols; ++x) {
      if (inverse_depth_(y, x) > 0) depth(y, x) = 1.0f / inverse_depth_(y, x);
    }
  }
  return depth;
}

}  // namespace portolan::synthetic
