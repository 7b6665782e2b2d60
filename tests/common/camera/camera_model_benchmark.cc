// Time to project and unproject one point; the agent does some hundreds of each a frame.
#include <benchmark/benchmark.h>

#include <vector>

#include "common/camera/camera_model.h"

namespace portolan {
namespace {

CameraModel Camera(DistortionModel distortion) {
  CameraIntrinsics intrinsics{752, 480, 458.654, 457.296, 367.215, 248.375, distortion, {}};
  if (distortion == DistortionModel::kRadTan) {
    intrinsics.coefficients = {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0};
  } else if (distortion == DistortionModel::kEquidistant) {
    intrinsics.coefficients = {-0.00893224, -0.03290984, -0.00518532, 0.00190938, 0};
  }
  return CameraModel::Create(intrinsics).value();
}

std::vector<Eigen::Vector2d> PixelGrid() {
  std::vector<Eigen::Vector2d> pixels;
  for (int y = 0; y < 480; y += 32) {
    for (int x = 0; x < 752; x += 32) pixels.emplace_back(x, y);
  }
  return pixels;
}

void Unproject(benchmark::State& state) {
  const CameraModel camera = Camera(static_cast<DistortionModel>(state.range(0)));
  const auto pixels = PixelGrid();
  size_t i = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(camera.Unproject(pixels[i]));
    i = i + 1 < pixels.size() ? i + 1 : 0;
  }
}

void ProjectWithJacobian(benchmark::State& state) {
  const CameraModel camera = Camera(static_cast<DistortionModel>(state.range(0)));
  std::vector<Eigen::Vector3d> points;
  for (const Eigen::Vector2d& pixel : PixelGrid()) points.push_back(2 * *camera.Unproject(pixel));
  size_t i = 0;
  Matrix23d jacobian;
  for (auto _ : state) {
    benchmark::DoNotOptimize(camera.Project(points[i], &jacobian));
    benchmark::DoNotOptimize(jacobian);
    i = i + 1 < points.size() ? i + 1 : 0;
  }
}

// none, radtan, equidistant
BENCHMARK(Unproject)->DenseRange(0, 2);
BENCHMARK(ProjectWithJacobian)->DenseRange(0, 2);

}  // namespace
}  // namespace portolan

BENCHMARK_MAIN();
