#include "tests/agent/revisit/wall_scene.h"

#include <random>

#include "tests/support/test_cameras.h"

namespace portolan {

WallScene::WallScene() : camera_(PinholeTestCamera()) {
  std::mt19937_64 random(8);
  std::uniform_real_distribution<double> x(-2.5, 2.5), y(-1.8, 1.8), z(4, 5);
  for (int i = 0; i < kWallPoints; ++i) {
    const double along = x(random), up = y(random), away = z(random);
    points_.emplace_back(along, up, away);
    Descriptor& descriptor = descriptors_.emplace_back();
    for (uint64_t& word : descriptor.words) word = random();
  }
}

Rigid3 WallScene::WorldFromKeyframe(int k) {
  return {Eigen::Quaterniond(RotationExp({0, 0.01 * (k - 4), 0})), {0.2 * (k - 4), 0.02 * k, 0}};
}

std::vector<Feature> WallScene::Features(const Rigid3& world_from_camera) const {
  const Rigid3 camera_from_world = world_from_camera.Inverse();
  std::vector<Feature> features;
  for (size_t i = 0; i < points_.size(); ++i) {
    const auto pixel = camera_.Project(camera_from_world * points_[i]);
    if (!pixel || !camera_.IsInImage(*pixel)) continue;
    Feature& feature = features.emplace_back();
    feature.pixel = pixel->cast<float>();
    feature.track = TrackId(static_cast<uint32_t>(i));
    feature.descriptor = descriptors_[i];
  }
  return features;
}

Submap WallScene::MakeSubmap(uint32_t sequence_number) const {
  Submap submap;
  submap.key.sequence_number = sequence_number;
  for (const CorrectedKeyframe& corrected : Keyframes()) {
    Keyframe& keyframe = submap.keyframes.emplace_back();
    keyframe.time = corrected.time;
    std::vector<Feature> features = Features(corrected.world_from_camera);
    for (const Feature& feature : features) {
      keyframe.observations.push_back({*feature.track, feature.pixel, 0.5f});
    }
    if (submap.keyframes.size() == 5) keyframe.features = std::move(features);
  }
  return submap;
}

std::vector<CorrectedKeyframe> WallScene::Keyframes() const {
  std::vector<CorrectedKeyframe> keyframes;
  for (int k = 0; k < 9; ++k) {
    keyframes.push_back({FromSeconds(0.2 * k), Rigid3(), WorldFromKeyframe(k)});
  }
  return keyframes;
}

LandmarkOffer WallScene::MakeOffer(uint64_t view, size_t first, size_t count) const {
  LandmarkOffer offer;
  offer.view = view;
  offer.component = ComponentId(1);
  offer.world_from_camera.scale = kWallScale;
  offer.first_index = static_cast<uint32_t>(first);
  for (size_t i = first; i < first + count; ++i) {
    offer.landmarks.push_back({points_[i] / kWallScale, 1e-3, 1e-2, descriptors_[i]});
  }
  return offer;
}

}  // namespace portolan
