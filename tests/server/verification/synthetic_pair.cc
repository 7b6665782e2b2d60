#include "tests/server/verification/synthetic_pair.h"

#include <Eigen/Cholesky>
#include <random>

#include "common/base/check.h"

namespace portolan {
namespace {

constexpr int kKeyframes = 6;
constexpr uint32_t kTrackOffsetOfB = 1000;

struct ScenePoint {
  Eigen::Vector3d position;
  Descriptor descriptor;
};

class PairBuilder {
 public:
  explicit PairBuilder(const SyntheticPairOptions& options)
      : options_(options), random_(options.seed) {
    auto camera = CameraModel::Create(options.camera);
    PORTOLAN_CHECK(camera.ok());
    camera_ = std::make_shared<CameraModel>(*camera);
  }

  SyntheticPair Build() {
    for (int i = 0; i < options_.points; ++i)
      points_.push_back(MakePoint(i, options_.common_from_x));
    SyntheticPair pair;
    pair.a = MakeSubmap(1, Rigid3::Identity(), 1.0, 0);
    pair.b = MakeSubmap(2, options_.a_from_b, options_.scale, kTrackOffsetOfB);
    pair.a_from_b = Similarity3::FromRigid(options_.a_from_b, options_.scale);
    return pair;
  }

 private:
  double Uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(random_()) / 18446744073709551616.0;
  }
  double Normal() {  // Irwin-Hall is near enough and the same with every library
    double sum = -6;
    for (int i = 0; i < 12; ++i) sum += Uniform(0, 1);
    return sum;
  }

  Descriptor RandomDescriptor() {
    Descriptor descriptor;
    for (uint64_t& word : descriptor.words) word = random_();
    return descriptor;
  }

  Descriptor Disturbed(Descriptor descriptor) {
    for (int i = 0; i < options_.noise_bits; ++i) {
      const uint64_t bit = random_() % 256;
      descriptor.words[bit / 64] ^= uint64_t{1} << (bit % 64);
    }
    return descriptor;
  }

  ScenePoint MakePoint(int index, double from_x) {
    ScenePoint point;
    const double x = Uniform(from_x, 4), y = Uniform(-3, 3);
    point.position = {x, y, options_.shape == SceneShape::kVolume ? Uniform(4, 8) : 6 + 0.3 * x};
    if (options_.shape == SceneShape::kLattice) {
      point.position = {0.5 * (index % 16) - 4, 0.5 * (index / 16) - 4, 6};
    }
    point.descriptor = options_.identical_descriptors ? Descriptor() : RandomDescriptor();
    return point;
  }

  RefinedSubmap MakeSubmap(int64_t id, const Rigid3& world_from_submap, double unit,
                           uint32_t track_offset) {
    std::vector<ScenePoint> points = points_;
    for (int i = 0; i < options_.private_points; ++i) points.push_back(MakePoint(i, -4));
    RefinedSubmap submap;
    submap.id = SubmapId(id);
    submap.camera = camera_;
    auto raw = std::make_shared<Submap>();
    raw->metric = options_.metric;
    for (int k = 0; k < kKeyframes; ++k) {
      Rigid3 pose;
      pose.translation = Eigen::Vector3d(options_.path * k / (kKeyframes - 1), 0.02 * k, 0) / unit;
      pose.rotation = RotationExp({0, -0.01 * k, 0.005 * k});
      submap.submap_from_camera.push_back(pose);
      raw->keyframes.emplace_back();
      raw->keyframes.back().submap_from_camera = pose;
    }
    const Similarity3 submap_from_world = Similarity3::FromRigid(world_from_submap, unit).Inverse();
    for (size_t i = 0; i < points.size(); ++i) {
      AddPoint(points[i], submap_from_world * points[i].position,
               TrackId(track_offset + static_cast<uint32_t>(i)), raw.get(), &submap);
    }
    submap.raw = raw;
    return submap;
  }

  void AddPoint(const ScenePoint& point, const Eigen::Vector3d& in_submap, TrackId track,
                Submap* raw, RefinedSubmap* submap) {
    Eigen::Matrix3d information = Eigen::Matrix3d::Identity() * 1e-6;
    int count = 0;
    for (int k = 0; k < kKeyframes; ++k) {
      const Rigid3 camera_from_submap = submap->submap_from_camera[k].Inverse();
      Matrix23d jacobian;
      const auto exact = camera_->Project(camera_from_submap * in_submap, &jacobian);
      if (!exact || !camera_->IsInImage(*exact, 5)) continue;
      const Eigen::Vector2f pixel =
          (*exact + options_.noise_px * Eigen::Vector2d(Normal(), Normal())).cast<float>();
      raw->keyframes[k].observations.push_back({track, pixel, 1.0f});
      if (k == 0 || k == kKeyframes - 1) {
        raw->keyframes[k].features.push_back({pixel, 0, track, Disturbed(point.descriptor)});
      }
      const Matrix23d in_pixels = jacobian * camera_from_submap.rotation.toRotationMatrix();
      information += in_pixels.transpose() * in_pixels;
      ++count;
    }
    if (count < 2) return;
    const Eigen::Matrix3d covariance = information.inverse();
    const Eigen::Vector3d noise(Normal(), Normal(), Normal());
    const Eigen::Matrix3d root = covariance.llt().matrixL();
    submap->landmarks.push_back(
        {track, count, in_submap + options_.noise_px * root * noise, covariance});
  }

  const SyntheticPairOptions options_;
  std::mt19937_64 random_;
  std::shared_ptr<const CameraModel> camera_;
  std::vector<ScenePoint> points_;
};

}  // namespace

SyntheticPair MakeSyntheticPair(const SyntheticPairOptions& options) {
  return PairBuilder(options).Build();
}

}  // namespace portolan
