#include "common/wire/correction_wire.h"

#include <cmath>
#include <random>
#include <vector>

#include "common/wire/agent_wire.h"
#include "common/wire/column_codec.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

using testing::HasSubstr;

MapCorrection Correction(int submaps) {
  MapCorrection correction;
  correction.map_version = 42;
  for (int i = 0; i < submaps; ++i) {
    SubmapPlacement placement;
    placement.sequence_number = static_cast<uint32_t>(3 * i);
    placement.component = ComponentId(1 + i % 2);
    placement.metric = i % 2 == 0;
    Vector7d tangent;
    tangent << 1.0 * i, 2, 3, 0.1, 0.2 * i, -0.3, 0.4;
    placement.world_from_submap = Similarity3::Exp(tangent);
    placement.covariance_diagonal.setConstant(0.5 + i);
    for (int k = 0; k < i; ++k) {
      placement.adjusted_submap_from_camera.push_back(Rigid3::Exp(0.1 * k * Vector6d::Ones()));
    }
    correction.submaps.push_back(placement);
  }
  return correction;
}

TEST(CorrectionWire, KeepsCorrections) {
  const MapCorrection correction = Correction(4);
  v1::Correction message;
  ToProto(correction, kProtocolVersion, &message);
  const auto value = FromProto(message);
  ASSERT_THAT(value, IsOk());
  EXPECT_EQ(value->map_version, 42u);
  ASSERT_EQ(value->submaps.size(), 4u);
  for (size_t i = 0; i < 4; ++i) {
    const SubmapPlacement& expected = correction.submaps[i];
    const SubmapPlacement& actual = value->submaps[i];
    EXPECT_EQ(actual.sequence_number, expected.sequence_number);
    EXPECT_EQ(actual.component, expected.component);
    EXPECT_EQ(actual.metric, expected.metric);
    EXPECT_THAT(actual.world_from_submap, NearSimilarity(expected.world_from_submap, 1e-12));
    EXPECT_THAT(actual.covariance_diagonal, NearMatrix(expected.covariance_diagonal, 1e-6));
    ASSERT_EQ(actual.adjusted_submap_from_camera.size(), i);
    for (size_t k = 0; k < i; ++k) {
      EXPECT_THAT(actual.adjusted_submap_from_camera[k],
                  NearRigid(expected.adjusted_submap_from_camera[k], 1e-4));
    }
  }
}

TEST(CorrectionWire, KeepsTheLens) {
  MapCorrection correction = Correction(2);
  correction.submaps[1].added_radial = {0.01, -0.2};
  v1::Correction message;
  ToProto(correction, kProtocolVersion, &message);
  const auto value = FromProto(message);
  ASSERT_THAT(value, IsOk());
  EXPECT_TRUE(value->submaps[0].added_radial.isZero(0));
  EXPECT_EQ(value->submaps[1].added_radial, correction.submaps[1].added_radial);
}

TEST(CorrectionWire, RefusesALensThatIsNone) {
  const MapCorrection correction = Correction(1);
  const std::vector<std::vector<double>> wrong = {
      {1}, {1, 2, 3}, {0, std::nan("")}, {HUGE_VAL, 0}, {0, -1e4}};
  for (const std::vector<double>& numbers : wrong) {
    v1::Correction message;
    ToProto(correction, kProtocolVersion, &message);
    for (const double number : numbers) message.mutable_submaps(0)->add_added_radial(number);
    EXPECT_THAT(FromProto(message).status().message(), HasSubstr("added_radial"));
  }
}

// A submap whose place is next to unknown does not cost the whole correction.
TEST(CorrectionWire, BoundsVariances) {
  MapCorrection correction = Correction(2);
  for (const double variance : {1e24, 1e300, HUGE_VAL, std::nan(""), -1.0}) {
    correction.submaps[0].covariance_diagonal[2] = variance;
    v1::Correction message;
    ToProto(correction, kProtocolVersion, &message);
    const auto value = FromProto(message);
    ASSERT_THAT(value, IsOk());
    EXPECT_GT(value->submaps[0].covariance_diagonal[2], 1e23);
  }
}

TEST(CorrectionWire, OldAgentsGetPosesAsNumbers) {
  const MapCorrection correction = Correction(4);
  v1::Correction message;
  ToProto(correction, 1, &message);
  EXPECT_FALSE(message.submaps(3).has_adjusted_poses());
  const auto value = FromProto(message);
  ASSERT_THAT(value, IsOk());
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_THAT(value->submaps[3].adjusted_submap_from_camera[k],
                NearRigid(correction.submaps[3].adjusted_submap_from_camera[k], 1e-6));
  }
}

TEST(CorrectionWire, PosesTakeHalfAsColumns) {
  MapCorrection correction = Correction(1);
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  Rigid3 pose;
  for (int k = 0; k < 16; ++k) {
    correction.submaps[0].adjusted_submap_from_camera.push_back(pose);
    Vector6d step;
    for (int i = 0; i < 6; ++i) step[i] = 0.05 * normal(random);
    pose = pose * Rigid3::Exp(step);
  }
  v1::Correction numbers, columns;
  ToProto(correction, 1, &numbers);
  ToProto(correction, 2, &columns);
  EXPECT_LT(columns.ByteSizeLong() + 14 * 16, numbers.ByteSizeLong());
}

TEST(CorrectionWire, SurvivesRandomDamageOfPoseColumns) {
  v1::Correction sound;
  ToProto(Correction(6), kProtocolVersion, &sound);
  const std::string bytes = sound.SerializeAsString();
  std::mt19937 random(4);
  int refused = 0;
  for (int round = 0; round < 5000; ++round) {
    std::string damaged = bytes;
    for (int hits = 1 + static_cast<int>(random() % 3); hits > 0; --hits) {
      damaged[random() % damaged.size()] = static_cast<char>(random());
    }
    v1::Correction message;
    if (!message.ParseFromString(damaged)) continue;
    const auto correction = FromProto(message);
    refused += correction.ok() ? 0 : 1;
    if (!correction.ok()) continue;
    for (const SubmapPlacement& placement : correction->submaps) {
      for (const Rigid3& pose : placement.adjusted_submap_from_camera) {
        EXPECT_TRUE(pose.translation.allFinite());
        EXPECT_NEAR(pose.rotation.norm(), 1, 1e-3);
      }
    }
  }
  EXPECT_GT(refused, 1000);
}

TEST(CorrectionWire, RefusesMalformedCorrections) {
  const auto refuses = [](const char* what, auto damage, uint32_t version = kProtocolVersion) {
    v1::Correction message;
    ToProto(Correction(3), version, &message);
    damage(&message);
    EXPECT_THAT(FromProto(message), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  refuses("submaps[1].component_id", [](auto* m) { m->mutable_submaps(1)->clear_component_id(); });
  refuses("submaps[2].world_from_submap",
          [](auto* m) { m->mutable_submaps(2)->clear_world_from_submap(); });
  refuses("submaps[1].sequence_number",
          [](auto* m) { m->mutable_submaps(1)->set_sequence_number(0); });
  refuses("covariance_diagonal",
          [](auto* m) { m->mutable_submaps(0)->set_covariance_diagonal(3, std::nanf("")); });
  refuses("covariance_diagonal",
          [](auto* m) { m->mutable_submaps(0)->add_covariance_diagonal(1); });
  refuses(
      "adjusted_submap_from_camera",
      [](auto* m) { m->mutable_submaps(2)->add_adjusted_submap_from_camera(1); }, 1);
  refuses(
      "adjusted_submap_from_camera[1]",
      [](auto* m) { m->mutable_submaps(2)->set_adjusted_submap_from_camera(7, 5); }, 1);
  const auto refuses_columns = [&](const char* what, auto damage) {
    refuses(what, [&](auto* m) { damage(m->mutable_submaps(2)->mutable_adjusted_poses()); });
  };
  refuses("both forms", [](auto* m) { m->mutable_submaps(2)->add_adjusted_submap_from_camera(1); });
  refuses_columns("adjusted_poses: too many", [](auto* c) { c->set_count(257); });
  refuses_columns("adjusted_poses: column", [](auto* c) { c->set_count(200); });
  refuses_columns("adjusted_poses: column", [](auto* c) { c->clear_rotation(); });
  refuses_columns("adjusted_poses: column",
                  [](auto* c) { c->mutable_translation()->append("xy"); });
  refuses_columns("translation_step", [](auto* c) { c->set_translation_step(std::nan("")); });
  refuses_columns("translation_step", [](auto* c) { c->set_translation_step(0); });
  refuses_columns("adjusted_poses", [](auto* c) { c->set_translation_step(std::ldexp(1, 60)); });
  refuses_columns("out of range", [](auto* c) {
    c->set_rotation(EncodeColumn(std::vector<int64_t>(6, INT64_MIN)));
  });
}

TEST(CorrectionWire, RefusesTooManySubmaps) {
  v1::Correction message;
  ToProto(Correction(1), kProtocolVersion, &message);
  for (uint32_t i = 1; i <= kMaxSubmapsPerCorrection; ++i) {
    *message.add_submaps() = message.submaps(0);
    message.mutable_submaps(static_cast<int>(i))->set_sequence_number(i);
  }
  EXPECT_THAT(FromProto(message),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("more than")));
}

TEST(SplitCorrection, KeepsAllInOrderAndMarksAllButTheLast) {
  const auto parts = SplitCorrection(Correction(7), 3);
  ASSERT_EQ(parts.size(), 3u);
  uint32_t next = 0;
  for (size_t i = 0; i < parts.size(); ++i) {
    EXPECT_EQ(parts[i].map_version, 42u);
    EXPECT_EQ(parts[i].more, i + 1 < parts.size());
    for (const auto& placement : parts[i].submaps) {
      EXPECT_EQ(placement.sequence_number, next);
      next += 3;
    }
  }
  EXPECT_EQ(next, 21u);
  EXPECT_EQ(SplitCorrection(Correction(0), 3).size(), 1u);
}

}  // namespace
}  // namespace portolan
