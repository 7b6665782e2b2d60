#include "common/wire/submap_wire.h"

#include <algorithm>
#include <functional>
#include <limits>

#include "common/wire/feature_codec.h"
#include "common/wire/submap_validation.h"
#include "tests/common/wire/random_submap.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

using testing::HasSubstr;

constexpr double kObservationError_px = 1.0 / 64 + 1e-4;
constexpr double kFeatureError_px = 1.0 / 32 + 1e-4;

Submap RoundTrip(const Submap& submap) {
  const auto bytes = EncodeSubmap(submap);
  EXPECT_THAT(bytes, IsOk());
  auto decoded = DecodeSubmap(bytes.value_or(""));
  EXPECT_THAT(decoded, IsOk());
  return decoded.ok() ? *std::move(decoded) : Submap();
}

TEST(SubmapWire, KeepsTheHeader) {
  const Submap submap = RandomSubmap({.sequence_number = 9});
  const Submap decoded = RoundTrip(submap);
  EXPECT_EQ(decoded.key, submap.key);
  EXPECT_EQ(decoded.link, LinkType::kConnected);
  EXPECT_FALSE(decoded.metric);
  ASSERT_TRUE(decoded.gravity_in_submap.has_value());
  EXPECT_THAT(*decoded.gravity_in_submap, NearMatrix(*submap.gravity_in_submap, 1e-6));
}

TEST(SubmapWire, KeepsEveryLinkTypeAndFlags) {
  Submap submap = RandomSubmap({.sequence_number = 1});
  submap.gravity_in_submap.reset();
  submap.metric = true;
  submap.link = LinkType::kBroken;
  Submap decoded = RoundTrip(submap);
  EXPECT_EQ(decoded.link, LinkType::kBroken);
  EXPECT_TRUE(decoded.metric);
  EXPECT_FALSE(decoded.gravity_in_submap.has_value());
  submap.key.sequence_number = 0;
  submap.link = LinkType::kNone;
  EXPECT_EQ(RoundTrip(submap).link, LinkType::kNone);
}

TEST(SubmapWire, KeepsKeyframesToFloatPrecision) {
  const Submap submap = RandomSubmap({});
  const Submap decoded = RoundTrip(submap);
  ASSERT_EQ(decoded.keyframes.size(), submap.keyframes.size());
  for (size_t i = 0; i < submap.keyframes.size(); ++i) {
    EXPECT_EQ(decoded.keyframes[i].time, submap.keyframes[i].time);
    EXPECT_THAT(decoded.keyframes[i].submap_from_camera,
                NearRigid(submap.keyframes[i].submap_from_camera, 2e-7));
    const Matrix6d& covariance = submap.keyframes[i].covariance;
    EXPECT_THAT(decoded.keyframes[i].covariance,
                NearMatrix(covariance, 2e-7 * covariance.diagonal().maxCoeff()));
  }
}

TEST(SubmapWire, KeepsObservationsToTheStatedStep) {
  const Submap submap = RandomSubmap({.seed = 4});
  const Submap decoded = RoundTrip(submap);
  for (size_t k = 0; k < submap.keyframes.size(); ++k) {
    const auto& expected = submap.keyframes[k].observations;
    const auto& actual = decoded.keyframes[k].observations;
    ASSERT_EQ(actual.size(), expected.size());
    for (size_t i = 0; i < expected.size(); ++i) {
      EXPECT_EQ(actual[i].track, expected[i].track);
      EXPECT_LE((actual[i].pixel - expected[i].pixel).cwiseAbs().maxCoeff(), kObservationError_px);
      EXPECT_NEAR(actual[i].sigma_px / expected[i].sigma_px, 1.0, 0.022);
    }
  }
}

TEST(SubmapWire, KeepsFeaturesSortedByRow) {
  Submap submap = RandomSubmap({.seed = 5});
  const Submap decoded = RoundTrip(submap);
  for (size_t k = 0; k < 2; ++k) {
    auto expected = submap.keyframes[k].features;
    const auto& actual = decoded.keyframes[k].features;
    ASSERT_EQ(actual.size(), expected.size());
    for (size_t i = 0; i < actual.size(); ++i) {
      const auto same = std::find_if(expected.begin(), expected.end(), [&](const Feature& f) {
        return f.descriptor == actual[i].descriptor;
      });
      ASSERT_NE(same, expected.end());
      EXPECT_LE((actual[i].pixel - same->pixel).cwiseAbs().maxCoeff(), kFeatureError_px);
      EXPECT_EQ(actual[i].half_octave, same->half_octave);
      EXPECT_EQ(actual[i].track, same->track);
      if (i > 0) {
        EXPECT_LE(actual[i - 1].pixel.y(), actual[i].pixel.y());
      }
    }
  }
}

// As agents of protocol version 1 wrote features.
void WritePlainForm(const std::vector<Keyframe>& keyframes, v1::FeatureColumns* columns) {
  columns->Clear();
  PlacedFeatureEncoder placed;
  for (const Keyframe& keyframe : keyframes) {
    columns->add_count(static_cast<uint32_t>(keyframe.features.size()));
    std::vector<Feature> features = keyframe.features;
    placed.AddKeyframe(&features);
    for (const Feature& feature : features) {
      for (const uint64_t word : feature.descriptor.words) {
        for (int shift = 0; shift < 64; shift += 8) {
          columns->mutable_descriptors()->push_back(static_cast<char>((word >> shift) & 0xff));
        }
      }
    }
  }
  placed.Write(columns);
}

TEST(SubmapWire, ReadsThePlainFormOfFeatures) {
  const Submap submap = RoundTrip(RandomSubmap({.seed = 8}));
  v1::Submap message;
  ASSERT_THAT(ToProto(submap, &message), IsOk());
  EXPECT_TRUE(message.features().compact());
  WritePlainForm(submap.keyframes, message.mutable_features());
  const auto plain = FromProto(message);
  ASSERT_THAT(plain, IsOk());
  for (size_t k = 0; k < submap.keyframes.size(); ++k) {
    const auto& expected = submap.keyframes[k].features;
    const auto& actual = plain->keyframes[k].features;
    ASSERT_EQ(actual.size(), expected.size());
    for (size_t i = 0; i < actual.size(); ++i) {
      EXPECT_LE((actual[i].pixel - expected[i].pixel).cwiseAbs().maxCoeff(), kFeatureError_px);
      EXPECT_EQ(actual[i].half_octave, expected[i].half_octave);
      EXPECT_EQ(actual[i].track, expected[i].track);
      EXPECT_EQ(actual[i].descriptor, expected[i].descriptor);
    }
  }
}

TEST(SubmapWire, KeepsFeaturesOnObservationsExactlyThere) {
  Submap submap = RandomSubmap({.keyframes = 2, .observations = 3, .features = 0});
  Keyframe& keyframe = submap.keyframes[1];
  const Observation& seen = keyframe.observations[1];
  // Twice at the same scale, at another one, beside the observation, and on an unobserved track.
  keyframe.features = {{seen.pixel, 1, seen.track, {{1, 2, 3, 4}}},
                       {seen.pixel, 1, seen.track, {{5, 6, 7, 8}}},
                       {seen.pixel, 32, seen.track, {{9, 0, 0, 9}}},
                       {seen.pixel + Eigen::Vector2f(0.5f, 0), 0, seen.track, {{3, 3, 3, 3}}},
                       {seen.pixel, 0, TrackId(7), {{4, 4, 4, 4}}}};
  const Submap decoded = RoundTrip(submap);
  const Eigen::Vector2f pixel = decoded.keyframes[1].observations[1].pixel;
  const auto& features = decoded.keyframes[1].features;
  ASSERT_EQ(features.size(), keyframe.features.size());
  int exact = 0;
  for (const Feature& feature : features) {
    exact += feature.pixel == pixel ? 1 : 0;
    const auto same =
        std::find_if(keyframe.features.begin(), keyframe.features.end(),
                     [&](const Feature& f) { return f.descriptor == feature.descriptor; });
    ASSERT_NE(same, keyframe.features.end());
    EXPECT_EQ(feature.half_octave, same->half_octave);
    EXPECT_EQ(feature.track, same->track);
  }
  EXPECT_GE(exact, 2);
}

TEST(SubmapWire, KeepsLandmarksToFloatPrecision) {
  const Submap submap = RandomSubmap({.seed = 6});
  const Submap decoded = RoundTrip(submap);
  ASSERT_EQ(decoded.landmarks.size(), submap.landmarks.size());
  for (size_t i = 0; i < submap.landmarks.size(); ++i) {
    const auto& expected = submap.landmarks[i];
    EXPECT_EQ(decoded.landmarks[i].track, expected.track);
    EXPECT_THAT(decoded.landmarks[i].point_in_submap, NearMatrix(expected.point_in_submap, 1e-6));
    EXPECT_THAT(decoded.landmarks[i].covariance,
                NearMatrix(expected.covariance, 2e-7 * expected.covariance.trace()));
  }
}

TEST(SubmapWire, KeepsFrameTimesExactlyAndPosesToTheStatedStep) {
  const Submap submap = RandomSubmap({.seed = 7, .frames = 1000});
  const Submap decoded = RoundTrip(submap);
  double largest = 0;
  for (const FramePose& frame : submap.frames) {
    largest = std::max(largest, frame.submap_from_camera.translation.cwiseAbs().maxCoeff());
  }
  ASSERT_EQ(decoded.frames.size(), submap.frames.size());
  for (size_t i = 0; i < submap.frames.size(); ++i) {
    const Rigid3& expected = submap.frames[i].submap_from_camera;
    const Rigid3& actual = decoded.frames[i].submap_from_camera;
    EXPECT_EQ(decoded.frames[i].time, submap.frames[i].time);
    EXPECT_LE((actual.translation - expected.translation).cwiseAbs().maxCoeff(),
              largest / (1 << 20) / 2 + 1e-12);
    EXPECT_LE(RotationLog(actual.rotation.conjugate() * expected.rotation).norm(), 1e-6);
  }
}

Submap SubmapWithFixes() {
  Submap submap = RandomSubmap({});
  submap.gnss.push_back({submap.keyframes.front().time, {47.123456789, -8.25, 411.5}, 0.5, 1.25});
  submap.gnss.push_back({submap.keyframes.back().time, {47.2, -8.5, 412}, 2, 4});
  submap.antenna_in_camera_m = {0.25, -0.5, 1};
  return submap;
}

TEST(SubmapWire, KeepsFixesExactly) {
  const Submap submap = SubmapWithFixes();
  const Submap decoded = RoundTrip(submap);
  ASSERT_EQ(decoded.gnss.size(), 2u);
  EXPECT_EQ(decoded.antenna_in_camera_m, submap.antenna_in_camera_m);
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(decoded.gnss[i].time, submap.gnss[i].time);
    EXPECT_EQ(decoded.gnss[i].position, submap.gnss[i].position);
    EXPECT_EQ(decoded.gnss[i].sigma_horizontal_m, submap.gnss[i].sigma_horizontal_m);
    EXPECT_EQ(decoded.gnss[i].sigma_vertical_m, submap.gnss[i].sigma_vertical_m);
  }
}

TEST(SubmapWire, MalformedFixesAreRefused) {
  v1::Submap good;
  ASSERT_THAT(ToProto(SubmapWithFixes(), &good), IsOk());
  const auto message_of = [&](const std::function<void(v1::GnssColumns*)>& spoil) {
    v1::Submap message = good;
    spoil(message.mutable_gnss());
    return std::string(FromProto(message).status().message());
  };
  EXPECT_EQ(message_of([](auto*) {}), "");
  EXPECT_THAT(message_of([](auto* g) { g->add_time_ns(5); }), HasSubstr("different lengths"));
  EXPECT_THAT(message_of([](auto* g) { g->set_time_ns(0, g->time_ns(0) - 1); }),
              HasSubstr("gnss[0].time"));
  EXPECT_THAT(message_of([](auto* g) { g->set_time_ns(1, g->time_ns(0)); }),
              HasSubstr("gnss[1].time"));
  EXPECT_THAT(message_of([](auto* g) { g->set_position(0, 91); }), HasSubstr("latitude"));
  EXPECT_THAT(
      message_of([](auto* g) { g->set_position(5, std::numeric_limits<double>::quiet_NaN()); }),
      HasSubstr("gnss[1].position"));
  EXPECT_THAT(message_of([](auto* g) { g->set_sigma_m(1, 0); }), HasSubstr("gnss[0].sigma"));
  EXPECT_THAT(message_of([](auto* g) { g->set_antenna_in_camera_m(0, 1e9f); }),
              HasSubstr("antenna_in_camera"));
  EXPECT_THAT(message_of([](auto* g) { g->add_antenna_in_camera_m(1); }),
              HasSubstr("antenna_in_camera"));
  EXPECT_THAT(message_of([](auto* g) {
                for (int i = 0; i < 2000; ++i) g->add_time_ns(i);
              }),
              HasSubstr("too many"));
}

TEST(SubmapWire, KeepsHalfTurnsBetweenFrames) {
  Submap submap = RandomSubmap({.frames = 20});
  for (size_t i = 1; i < submap.frames.size(); ++i) {
    submap.frames[i].submap_from_camera.rotation =
        RotationExp(Eigen::Vector3d(0, i % 2 == 0 ? 0.0 : 3.14159, 0.001 * static_cast<double>(i)));
  }
  const Submap decoded = RoundTrip(submap);
  for (size_t i = 0; i < submap.frames.size(); ++i) {
    const auto& q = submap.frames[i].submap_from_camera.rotation;
    EXPECT_LE(RotationLog(decoded.frames[i].submap_from_camera.rotation.conjugate() * q).norm(),
              1e-6);
  }
}

TEST(SubmapWire, KeepsTheSmallestSubmap) {
  Submap submap;
  submap.key = {AgentId("a"), SessionId(1), 0};
  submap.keyframes.resize(1);
  const Submap decoded = RoundTrip(submap);
  EXPECT_EQ(decoded.keyframes.size(), 1u);
  EXPECT_TRUE(decoded.frames.empty());
  EXPECT_TRUE(decoded.landmarks.empty());
}

TEST(SubmapWire, KeepsExtremeTracksAndPixels) {
  Submap submap = RandomSubmap({.keyframes = 2, .observations = 0, .features = 0});
  submap.keyframes[0].observations = {{TrackId(0), {-32768, 32768}, 0.0625f},
                                      {TrackId(UINT32_MAX), {32768, -32768}, 4000.0f}};
  submap.keyframes[1].observations = {{TrackId(UINT32_MAX), {-32768, 32768}, 1.0f}};
  const Submap decoded = RoundTrip(submap);
  EXPECT_EQ(decoded.keyframes[0].observations[1].track, TrackId(UINT32_MAX));
  EXPECT_EQ(decoded.keyframes[0].observations[1].pixel, Eigen::Vector2f(32768, -32768));
  EXPECT_EQ(decoded.keyframes[1].observations[0].pixel, Eigen::Vector2f(-32768, 32768));
}

TEST(SubmapWire, EncodesTheSameBytesEachTimeAndIsStableOnceRounded) {
  const Submap submap = RandomSubmap({});
  const auto bytes = EncodeSubmap(submap);
  EXPECT_EQ(*bytes, *EncodeSubmap(submap));
  const Submap once = RoundTrip(submap);
  const Submap twice = RoundTrip(once);
  for (size_t k = 0; k < once.keyframes.size(); ++k) {
    for (size_t i = 0; i < once.keyframes[k].observations.size(); ++i) {
      EXPECT_EQ(once.keyframes[k].observations[i].pixel, twice.keyframes[k].observations[i].pixel);
      EXPECT_EQ(once.keyframes[k].observations[i].sigma_px,
                twice.keyframes[k].observations[i].sigma_px);
    }
  }
}

TEST(SubmapWire, TypicalSubmapIsSmall) {
  v1::Submap message;
  ASSERT_THAT(ToProto(RandomSubmap({}), &message), IsOk());
  const WireSizes sizes = SizesOf(message);
  EXPECT_EQ(sizes.Total(), message.ByteSizeLong());
  // Random descriptors cannot be coded; those of images can (DescriptorCodec).
  EXPECT_LT(sizes.Total(), 45'000u);
  EXPECT_LE(sizes.frame_times + sizes.frame_poses, 90u * 16u);
  EXPECT_LT(sizes.feature_descriptors, 800u * 40u);
}

}  // namespace
}  // namespace portolan
