// Cost of the tracker per image, on a shifted noise image of EuRoC's size with 200 points.
#include <benchmark/benchmark.h>

#include <opencv2/imgproc.hpp>

#include "agent/tracker/image_pyramid.h"
#include "agent/tracker/patch_flow.h"
#include "agent/tracker/reference_patch.h"
#include "agent/tracker/response_map.h"
#include "agent/tracker/tracker.h"
#include "common/base/check.h"

namespace portolan {
namespace {

constexpr int kWidth = 752, kHeight = 480;
constexpr int kShiftPx = 4;

// Two views of one plane, the second moved to the right.
struct Views {
  cv::Mat first, second;
  Views() {
    cv::Mat noise(kHeight, kWidth + kShiftPx, CV_8UC1);
    cv::RNG rng(7);
    rng.fill(noise, cv::RNG::UNIFORM, 0, 256);
    cv::GaussianBlur(noise, noise, cv::Size(), 3.0);
    cv::normalize(noise, noise, 0, 255, cv::NORM_MINMAX);
    first = noise(cv::Rect(kShiftPx, 0, kWidth, kHeight)).clone();
    second = noise(cv::Rect(0, 0, kWidth, kHeight)).clone();
  }
};

CameraModel Camera() {
  CameraIntrinsics intrinsics;
  intrinsics.width_px = kWidth;
  intrinsics.height_px = kHeight;
  intrinsics.fx_px = intrinsics.fy_px = 458.0;
  intrinsics.cx_px = 367.0;
  intrinsics.cy_px = 248.0;
  auto camera = CameraModel::Create(intrinsics);
  PORTOLAN_CHECK(camera.ok());
  return *camera;
}

std::unique_ptr<Tracker> MakeTracker(const cv::Mat& first) {
  cv::setNumThreads(1);
  auto tracker = Tracker::Create({}, Camera());
  PORTOLAN_CHECK(tracker.ok());
  PORTOLAN_CHECK((*tracker)->Track(first, {}, Eigen::Quaterniond::Identity()).ok());
  (*tracker)->Detect();
  return std::move(*tracker);
}

void BM_Track(benchmark::State& state) {
  const Views views;
  const auto tracker = MakeTracker(views.first);
  bool second = true;
  for (auto _ : state) {
    const cv::Mat& image = second ? views.second : views.first;
    PORTOLAN_CHECK(tracker->Track(image, {}, Eigen::Quaterniond::Identity()).ok());
    second = !second;
  }
  state.counters["tracks"] = static_cast<double>(tracker->points().size());
}
BENCHMARK(BM_Track)->Unit(benchmark::kMillisecond);

void BM_DetectAll(benchmark::State& state) {
  const Views views;
  for (auto _ : state) {
    state.PauseTiming();
    auto tracker = Tracker::Create({}, Camera());
    PORTOLAN_CHECK((*tracker)->Track(views.first, {}, Eigen::Quaterniond::Identity()).ok());
    state.ResumeTiming();
    benchmark::DoNotOptimize((*tracker)->Detect());
  }
}
BENCHMARK(BM_DetectAll)->Unit(benchmark::kMillisecond);

void BM_Describe(benchmark::State& state) {
  const Views views;
  const auto tracker = MakeTracker(views.first);
  size_t features = 0;
  for (auto _ : state) features = tracker->Describe().size();
  state.counters["features"] = static_cast<double>(features);
}
BENCHMARK(BM_Describe)->Unit(benchmark::kMillisecond);

void BM_Reacquire(benchmark::State& state) {
  const Views views;
  for (auto _ : state) {
    state.PauseTiming();
    const auto tracker = MakeTracker(views.first);
    std::vector<SearchRegion> regions;
    for (const TrackedPoint& p : tracker->points()) {
      regions.push_back({p.track, p.pixel, 9.0 * Eigen::Matrix2d::Identity()});
    }
    const cv::Mat flat(kHeight, kWidth, CV_8UC1, cv::Scalar(90));
    PORTOLAN_CHECK(tracker->Track(flat, {}, Eigen::Quaterniond::Identity()).ok());
    PORTOLAN_CHECK(tracker->Track(views.second, {}, Eigen::Quaterniond::Identity()).ok());
    state.ResumeTiming();
    state.counters["found"] = static_cast<double>(tracker->Reacquire(regions).size());
  }
}
BENCHMARK(BM_Reacquire)->Unit(benchmark::kMillisecond);

void BM_Pyramid(benchmark::State& state) {
  const Views views;
  ImagePyramid pyramid;
  for (auto _ : state) pyramid.Build(views.first, 3);
}
BENCHMARK(BM_Pyramid)->Unit(benchmark::kMicrosecond);

void BM_FlowOfOnePoint(benchmark::State& state) {
  const Views views;
  ImagePyramid first, second;
  first.Build(views.first, 3);
  second.Build(views.second, 3);
  const Eigen::Vector2d point(300, 200);
  for (auto _ : state) {
    benchmark::DoNotOptimize(TrackTranslation(first, second, point, {&point, 1}, 1));
  }
}
BENCHMARK(BM_FlowOfOnePoint)->Unit(benchmark::kMicrosecond);

void BM_AlignOnePatch(benchmark::State& state) {
  const Views views;
  ImagePyramid first, second;
  first.Build(views.first, 3);
  second.Build(views.second, 3);
  const auto patch = ReferencePatch::Create(first, {300, 200});
  PORTOLAN_CHECK(patch.has_value());
  const PatchPose start{{304.6, 200.5}, Eigen::Matrix2d::Identity()};
  for (auto _ : state) benchmark::DoNotOptimize(patch->Align(second, start));
}
BENCHMARK(BM_AlignOnePatch)->Unit(benchmark::kMicrosecond);

void BM_ResponseOfOneCell(benchmark::State& state) {
  const Views views;
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        ComputeResponse(views.first, cv::Rect(200, 200, 44, 44), CornerMeasure::kSmallEigenvalue));
  }
}
BENCHMARK(BM_ResponseOfOneCell)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace portolan

BENCHMARK_MAIN();
