#include "tests/server/store/store_test_util.h"

#include <gtest/gtest.h>

#include <random>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace portolan::testing {
namespace {

Eigen::Quaterniond DrawRotation(std::mt19937& random) {
  std::normal_distribution<double> normal;
  return Eigen::Quaterniond(normal(random), normal(random), normal(random), normal(random))
      .normalized();
}

Eigen::Vector3d DrawVector(std::mt19937& random) {
  std::normal_distribution<double> normal;
  return {normal(random), normal(random), normal(random)};
}

template <int N>
Eigen::Matrix<double, N, N> DrawCovariance(std::mt19937& random) {
  std::normal_distribution<double> normal;
  const Eigen::Matrix<double, N, N> root =
      Eigen::Matrix<double, N, N>::NullaryExpr([&] { return normal(random); });
  const Eigen::Matrix<double, N, N> product = root * root.transpose();
  return 0.5 * (product + product.transpose());
}

void ExpectSameState(const SubmapState& actual, const SubmapState& expected) {
  EXPECT_EQ(actual.refined->id, expected.refined->id);
  EXPECT_EQ(actual.component, expected.component);
  EXPECT_EQ(actual.moved_at_version, expected.moved_at_version);
  EXPECT_EQ(actual.world_from_submap.scale, expected.world_from_submap.scale);
  EXPECT_EQ(actual.world_from_submap.rotation.coeffs(),
            expected.world_from_submap.rotation.coeffs());
  EXPECT_EQ(actual.covariance, expected.covariance);
  EXPECT_EQ(actual.refined->quarantine_reason, expected.refined->quarantine_reason);
  EXPECT_EQ(actual.refined->rms_reprojection_px, expected.refined->rms_reprojection_px);
  ASSERT_EQ(actual.refined->landmarks.size(), expected.refined->landmarks.size());
  ASSERT_EQ(actual.world_from_camera.size(), expected.world_from_camera.size());
  for (size_t i = 0; i < actual.world_from_camera.size(); ++i) {
    EXPECT_EQ(actual.world_from_camera[i].Matrix(), expected.world_from_camera[i].Matrix());
  }
  ASSERT_EQ(actual.landmarks.size(), expected.landmarks.size());
  for (size_t i = 0; i < actual.landmarks.size(); ++i) {
    EXPECT_EQ(actual.landmarks[i].id, expected.landmarks[i].id);
    EXPECT_EQ(actual.landmarks[i].point_in_world, expected.landmarks[i].point_in_world);
    EXPECT_EQ(actual.landmarks[i].covariance, expected.landmarks[i].covariance);
    EXPECT_EQ(actual.landmarks[i].sights, expected.landmarks[i].sights);
  }
}

void ExpectSameClosures(const ClosureList& actual, const ClosureList& expected) {
  ASSERT_EQ(actual.size(), expected.size());
  for (size_t i = 0; i < actual.size(); ++i) {
    EXPECT_EQ(actual[i].b, expected[i].b);
    EXPECT_EQ(actual[i].matches, expected[i].matches);
    EXPECT_EQ(actual[i].information, expected[i].information);
  }
}

}  // namespace

SessionRecord MakeSession(const std::string& agent, uint64_t session) {
  SessionRecord record;
  record.agent = AgentId(agent);
  record.session = SessionId(session);
  record.camera = {.width_px = 640,
                   .height_px = 480,
                   .fx_px = 500,
                   .fy_px = 501,
                   .cx_px = 320,
                   .cy_px = 240,
                   .distortion = DistortionModel::kRadTan,
                   .coefficients = {-0.1, 0.01, 0.001, -0.002, 0}};
  return record;
}

NewSubmap MakeSubmap(const std::string& agent, uint64_t session, uint32_t sequence_number,
                     int keyframes) {
  NewSubmap submap;
  submap.key = {AgentId(agent), SessionId(session), sequence_number};
  submap.bytes = absl::StrCat(agent, "|", session, "|", sequence_number, "|", keyframes);
  return submap;
}

StatusOr<Submap> DecodeTestSubmap(std::string_view bytes) {
  const std::vector<std::string> parts = absl::StrSplit(std::string(bytes), '|');
  Submap submap;
  uint64_t session = 0;
  int keyframes = 0;
  if (parts.size() != 4 || !absl::SimpleAtoi(parts[1], &session) ||
      !absl::SimpleAtoi(parts[2], &submap.key.sequence_number) ||
      !absl::SimpleAtoi(parts[3], &keyframes)) {
    return absl::InvalidArgumentError("not a test submap");
  }
  submap.key.agent = AgentId(parts[0]);
  submap.key.session = SessionId(session);
  submap.keyframes.resize(keyframes);
  return submap;
}

std::shared_ptr<const SubmapState> MakeState(const StoredSubmap& stored, ComponentId component,
                                             const Eigen::Vector3d& position, int landmarks,
                                             unsigned seed) {
  std::mt19937 random(seed);
  auto refined = std::make_shared<RefinedSubmap>();
  refined->id = stored.id;
  refined->raw = stored.submap;
  refined->camera = stored.camera;
  refined->rms_reprojection_px = 0.5;
  auto state = std::make_shared<SubmapState>();
  state->component = component;
  state->world_from_submap = {2.0, DrawRotation(random), position};
  state->covariance = DrawCovariance<7>(random);
  state->moved_at_version = seed;
  for (size_t i = 0; i < stored.submap->keyframes.size(); ++i) {
    refined->submap_from_camera.push_back({DrawRotation(random), DrawVector(random)});
    state->world_from_camera.push_back({DrawRotation(random), DrawVector(random)});
  }
  for (int i = 0; i < landmarks; ++i) {
    const TrackId track(100 + i);
    refined->landmarks.push_back({track, 4, DrawVector(random), DrawCovariance<3>(random)});
    const LandmarkSight sight{stored.id, track};
    state->landmarks.push_back({LandmarkIdOf(sight),
                                position + DrawVector(random),
                                DrawCovariance<3>(random),
                                4,
                                {sight}});
  }
  state->refined = std::move(refined);
  return state;
}

Closure MakeClosure(SubmapId a, SubmapId b, int matches) {
  Closure closure;
  closure.a = a;
  closure.b = b;
  closure.a_from_b.scale = 1.5;
  closure.rms_px = 0.7;
  for (int i = 0; i < matches; ++i) {
    closure.matches.push_back({TrackId(i), TrackId(1000 + i)});
  }
  return closure;
}

void ExpectSameSnapshot(const MapSnapshot& actual, const MapSnapshot& expected) {
  EXPECT_EQ(actual.version, expected.version);
  ASSERT_EQ(actual.submaps.size(), expected.submaps.size());
  for (size_t i = 0; i < actual.submaps.size(); ++i) {
    ExpectSameState(*actual.submaps[i], *expected.submaps[i]);
  }
  ASSERT_EQ(actual.components.size(), expected.components.size());
  for (size_t i = 0; i < actual.components.size(); ++i) {
    EXPECT_EQ(actual.components[i].id, expected.components[i].id);
    EXPECT_EQ(actual.components[i].metric, expected.components[i].metric);
  }
  ExpectSameClosures(*actual.closures, *expected.closures);
  ExpectSameClosures(*actual.waiting_closures, *expected.waiting_closures);
}

}  // namespace portolan::testing
