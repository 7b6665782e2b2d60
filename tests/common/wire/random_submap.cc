#include "tests/common/wire/random_submap.h"

#include <algorithm>
#include <random>

namespace portolan {
namespace {

constexpr int64_t kFramePeriod_ns = 50'000'000;

class Generator {
 public:
  explicit Generator(const RandomSubmapOptions& options) : o_(options), random_(options.seed) {}

  Submap Make() {
    Submap submap;
    submap.key = {AgentId("agent-7"), SessionId(0x1234567890abcdefu), o_.sequence_number};
    submap.link = o_.sequence_number == 0 ? LinkType::kNone : LinkType::kConnected;
    submap.gravity_in_submap = Eigen::Vector3d(0.1, 0.9, 0.2).normalized();
    MakeFrames(&submap);
    MakeKeyframes(&submap);
    MakeLandmarks(&submap);
    return submap;
  }

 private:
  double Normal(double sigma) { return std::normal_distribution<double>(0, sigma)(random_); }
  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }

  Rigid3 Pose(int frame) {
    Vector6d jitter;
    for (int i = 0; i < 6; ++i) jitter[i] = Normal(0.001);
    Vector6d motion;
    motion << 0.008 * frame, 0.001 * frame, 0.002 * frame, 0.0005 * frame, 0.003 * frame, 0;
    return Rigid3::Exp(motion) * Rigid3::Exp(frame == 0 ? Vector6d::Zero() : jitter);
  }

  void MakeFrames(Submap* submap) {
    const int64_t start_ns = 1'403'636'579'763'555'584;
    for (int i = 0; i < o_.frames; ++i) {
      const auto jitter_ns = static_cast<int64_t>(Normal(200));
      submap->frames.push_back({Timestamp(start_ns + i * kFramePeriod_ns + jitter_ns), Pose(i)});
    }
  }

  template <int N>
  Eigen::Matrix<double, N, N> Covariance(double sigma) {
    Eigen::Matrix<double, N, N> root;
    for (int i = 0; i < N * N; ++i) root(i) = Normal(sigma);
    return root * root.transpose();
  }

  void MakeKeyframes(Submap* submap) {
    uint32_t first_track = 70'000;
    std::vector<Eigen::Vector2d> pixels;
    for (int i = 0; i < o_.observations; ++i) pixels.push_back(RandomPixel());
    for (int k = 0; k < o_.keyframes; ++k) {
      Keyframe keyframe;
      const int frame = k * (o_.frames - 1) / std::max(1, o_.keyframes - 1);
      keyframe.time = submap->frames[static_cast<size_t>(frame)].time;
      keyframe.submap_from_camera = submap->frames[static_cast<size_t>(frame)].submap_from_camera;
      if (k > 0) keyframe.covariance = Covariance<6>(0.01);
      for (int i = 0; i < o_.observations; ++i) {
        const TrackId track(first_track + static_cast<uint32_t>(i));
        const float sigma_px = i % 5 == 0 ? 0.7f : 1.0f;
        keyframe.observations.push_back(
            {track, pixels[static_cast<size_t>(i)].cast<float>(), sigma_px});
      }
      if (k < o_.described_keyframes) MakeFeatures(&keyframe);
      submap->keyframes.push_back(keyframe);
      // A tenth of the tracks is lost, the others move on.
      const int lost = o_.observations / 10;
      first_track += static_cast<uint32_t>(lost);
      pixels.erase(pixels.begin(), pixels.begin() + lost);
      for (auto& pixel : pixels) pixel += Eigen::Vector2d(25 + Normal(4), 3 + Normal(3));
      for (int i = 0; i < lost; ++i) pixels.push_back(RandomPixel());
    }
  }

  Eigen::Vector2d RandomPixel() { return {Uniform(0, 752), Uniform(0, 480)}; }

  void MakeFeatures(Keyframe* keyframe) {
    std::uniform_int_distribution<uint64_t> word;
    for (int i = 0; i < o_.features; ++i) {
      Feature feature;
      feature.pixel = RandomPixel().cast<float>();
      feature.half_octave = static_cast<uint8_t>(Uniform(0, 8));
      if (i % 3 == 0 && !keyframe->observations.empty()) {
        const auto at = static_cast<size_t>(i) % keyframe->observations.size();
        feature.track = keyframe->observations[at].track;
        feature.pixel = keyframe->observations[at].pixel;
      }
      for (auto& w : feature.descriptor.words) w = word(random_);
      keyframe->features.push_back(feature);
    }
  }

  void MakeLandmarks(Submap* submap) {
    for (int i = 0; i < o_.landmarks; ++i) {
      SubmapLandmark landmark;
      landmark.track = TrackId(70'000 + 3 * static_cast<uint32_t>(i));
      landmark.point_in_submap = Eigen::Vector3d(Normal(2), Normal(2), Uniform(1, 8));
      landmark.covariance = Covariance<3>(0.05) + 1e-6 * Eigen::Matrix3d::Identity();
      submap->landmarks.push_back(landmark);
    }
  }

  const RandomSubmapOptions o_;
  std::mt19937_64 random_;
};

}  // namespace

Submap RandomSubmap(const RandomSubmapOptions& options) { return Generator(options).Make(); }

}  // namespace portolan
