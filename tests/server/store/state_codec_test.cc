#include "server/store/state_codec.h"

#include <gtest/gtest.h>

#include <random>

#include "server/store/blob.h"
#include "tests/server/store/store_test_util.h"
#include "tests/support/test_cameras.h"

namespace portolan {
namespace {

using testing::MakeClosure;
using testing::MakeState;

StoredSubmap MakeStored(int keyframes) {
  Submap submap;
  submap.keyframes.resize(keyframes);
  return {SubmapId(5), std::make_shared<const Submap>(submap), nullptr, 0};
}

// Decodes every truncation and many single-byte changes of `bytes`; only the result's ok() is of
// interest, and that the sanitizers stay silent.
template <typename Decode>
void ExpectSurvivesDamage(const std::string& bytes, Decode decode) {
  for (size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_FALSE(decode(std::string_view(bytes).substr(0, size))) << size;
  }
  std::mt19937 random(1);
  for (int i = 0; i < 2000; ++i) {
    std::string damaged = bytes;
    damaged[random() % damaged.size()] = static_cast<char>(random());
    decode(damaged);
  }
  EXPECT_FALSE(decode(bytes + "x")) << "trailing bytes";
}

TEST(StateCodec, RefinedSubmapRoundTrips) {
  const auto state = MakeState(MakeStored(3), ComponentId(1), {1, 2, 3}, 4, 1);
  const std::string bytes = EncodeRefined(*state->refined);
  RefinedSubmap decoded;
  decoded.raw = state->refined->raw;
  ASSERT_TRUE(DecodeRefined(bytes, &decoded).ok());
  EXPECT_EQ(EncodeRefined(decoded), bytes);
  EXPECT_EQ(decoded.landmarks[3].covariance, state->refined->landmarks[3].covariance);
  decoded.raw = MakeStored(2).submap;
  EXPECT_FALSE(DecodeRefined(bytes, &decoded).ok()) << "other number of keyframes";
}

TEST(StateCodec, RedundantKeyframesAreKeptAndChecked) {
  const auto state = MakeState(MakeStored(5), ComponentId(1), {1, 2, 3}, 4, 1);
  RefinedSubmap refined = *state->refined;
  const auto decode = [&](std::vector<int> redundant, RefinedSubmap* decoded) {
    refined.redundant_keyframes = std::move(redundant);
    decoded->raw = refined.raw;
    return DecodeRefined(EncodeRefined(refined), decoded).ok();
  };
  ASSERT_GE(refined.submap_from_camera.size(), 5u);
  const int last = static_cast<int>(refined.submap_from_camera.size()) - 1;
  refined.landmarks[1].redundant_count = 2;
  RefinedSubmap decoded;
  ASSERT_TRUE(decode({1, last - 1}, &decoded));
  EXPECT_EQ(decoded.redundant_keyframes, refined.redundant_keyframes);
  EXPECT_EQ(decoded.landmarks[1].redundant_count, 2);
  for (const std::vector<int>& wrong :
       {std::vector<int>{0}, {last}, {1, 1}, {2, 1}, {-1}, {last + 1}}) {
    EXPECT_FALSE(decode(wrong, &decoded));
  }
}

TEST(StateCodec, LensIsKept) {
  const auto camera =
      std::make_shared<const CameraModel>(CameraModel::Create(SubmapTestCamera()).value());
  auto refined = std::make_shared<RefinedSubmap>();
  refined->camera = camera;
  SubmapState state;
  state.refined = refined;
  state.camera = std::make_shared<const CameraModel>(camera->WithRadial({0.01, -0.02}).value());
  SubmapState decoded;
  decoded.refined = refined;
  ASSERT_TRUE(DecodePose(EncodePose(state), &decoded).ok());
  ASSERT_NE(decoded.camera, nullptr);
  EXPECT_NEAR(decoded.camera->intrinsics().coefficients[1],
              state.camera->intrinsics().coefficients[1], 1e-15);
  state.camera = camera;
  ASSERT_TRUE(DecodePose(EncodePose(state), &decoded).ok());
  EXPECT_EQ(decoded.camera, camera);
}

TEST(StateCodec, DamagedBlobsAreErrors) {
  const auto state = MakeState(MakeStored(2), ComponentId(1), {1, 2, 3}, 3, 1);
  ExpectSurvivesDamage(EncodeRefined(*state->refined), [&](std::string_view bytes) {
    RefinedSubmap decoded;
    decoded.raw = state->refined->raw;
    return DecodeRefined(bytes, &decoded).ok();
  });
  ExpectSurvivesDamage(EncodePose(*state), [](std::string_view bytes) {
    SubmapState decoded;
    return DecodePose(bytes, &decoded).ok();
  });
  ExpectSurvivesDamage(EncodeLandmarks(state->landmarks),
                       [](std::string_view bytes) { return DecodeLandmarks(bytes).ok(); });
  ExpectSurvivesDamage(EncodeClosure(MakeClosure(SubmapId(1), SubmapId(2), 3)),
                       [](std::string_view bytes) {
                         Closure decoded;
                         return DecodeClosure(bytes, &decoded).ok();
                       });
}

TEST(BlobReader, CountThatCannotFollowIsRefused) {
  BlobWriter writer;
  writer.Write(uint32_t{0xffffffff});
  writer.Write(1.0);
  BlobReader reader(writer.bytes());
  EXPECT_EQ(reader.ReadCount(8), 0u);
  EXPECT_FALSE(reader.ok());
}

TEST(HashBytes, KnownValues) {
  // From the FNV reference: the empty string and "a".
  EXPECT_EQ(HashBytes(""), 0xcbf29ce484222325u);
  EXPECT_EQ(HashBytes("a"), 0xaf63dc4c8601ec8cu);
}

}  // namespace
}  // namespace portolan
