// Renders a world of rectangles through a camera model: a ray for every pixel from a table, a
// depth buffer over surfaces, mip-mapped texture with up to four samples along the longer side of
// a pixel's footprint, four rays in pixels that an edge crosses.
#ifndef PORTOLAN_TESTS_SYNTHETIC_RENDERER_H_
#define PORTOLAN_TESTS_SYNTHETIC_RENDERER_H_

#include <opencv2/core.hpp>
#include <vector>

#include "common/camera/camera_model.h"
#include "common/geometry/rigid3.h"
#include "tests/synthetic/world.h"

namespace portolan::synthetic {

// Thread-compatible: one object a thread. The world is borrowed and must outlive it. Fields of
// view must stay under 180 degrees; pixels without a ray show the background.
class Renderer {
 public:
  Renderer(const CameraModel& camera, const World& world);

  // Grey values 0 ... 255 without noise. The pose is the optical frame's.
  void Render(const Rigid3& world_from_camera, cv::Mat1f* image);

  // Depth along the optical axis in metres of the last rendered view; 0 where nothing was hit.
  cv::Mat1f Depth() const;

 private:
  // A surface seen from the present camera. With ray = (x, y, 1) in the camera frame:
  // inverse depth w = n . ray, texture coordinates (u . ray / w, v . ray / w) - offset.
  struct View {
    Eigen::Vector3f n, u, v;
    float u_offset, v_offset;
    float width_m, height_m;
    const Surface* surface;
    // Corners clipped to the front of the camera, normalised coordinates.
    std::vector<Eigen::Vector2f> outline;
    float x_min, x_max, y_min, y_max;
  };
  // Square of pixels and the range of its rays.
  struct Tile {
    cv::Rect pixels;
    float x_min, x_max, y_min, y_max;
  };

  void BuildRays(const CameraModel& camera);
  void BuildTiles();
  void BuildViews(const Rigid3& world_from_camera);
  static bool Overlaps(const View& view, const Tile& tile);
  void DrawDepth(int view_index, const Tile& tile);
  void Shade(cv::Mat1f* image) const;
  bool IsEdge(int x, int y) const;
  float ShadeEdge(int x, int y) const;
  // Grey of a view along a ray whose neighbours in x and y differ by ray_dx, ray_dy.
  static float ShadeRay(const View& view, const Eigen::Vector3f& ray, const Eigen::Vector3f& ray_dx,
                        const Eigen::Vector3f& ray_dy);

  const World& world_;
  cv::Mat1f ray_x_, ray_y_;  // NaN where the camera model has no ray
  std::vector<Tile> tiles_;
  std::vector<View> views_;
  cv::Mat1f inverse_depth_;
  cv::Mat1s view_of_pixel_;  // -1: none
};

}  // namespace portolan::synthetic

#endif  // PORTOLAN_TESTS_SYNTHETIC_RENDERER_H_
