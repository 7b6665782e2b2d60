#include "common/wire/descriptor_codec.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "common/features/brief_pattern.h"
#include "common/features/feature_extractor.h"
#include "common/wire/crc32c.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

using testing::HasSubstr;

struct DescribedImage {
  std::vector<Descriptor> descriptors;
  std::vector<DescriptorReferences> references;
};

// Points of a random texture at two scales, in two images of it.
DescribedImage DescribeTexture() {
  cv::Mat texture(240, 320, CV_8UC1);
  cv::theRNG().state = 7;
  cv::randu(texture, 0, 255);
  cv::GaussianBlur(texture, texture, cv::Size(0, 0), 3);
  cv::normalize(texture, texture, 0, 255, cv::NORM_MINMAX);
  std::vector<Eigen::Vector2d> points;
  for (int y = 40; y < 200; y += 20) {
    for (int x = 40; x < 280; x += 20) points.emplace_back(x, y);
  }
  DescribedImage result;
  for (int image = 0; image < 2; ++image) {
    const auto described = ExtractFeatures(texture, points, {.max_extra_corners = 0});
    EXPECT_THAT(described, IsOk());
    const auto begin = static_cast<int>(result.descriptors.size());
    const auto count = static_cast<int>(described->size());
    for (int i = 0; i < count; ++i) {
      const DescribedPoint& point = (*described)[static_cast<size_t>(i)];
      result.descriptors.push_back(point.descriptor);
      result.references.push_back({point.half_octave > 0 ? begin + i - 1 : -1, image > 0 ? i : -1});
    }
    texture.convertTo(texture, -1, 0.8, 10);
  }
  return result;
}

std::vector<Descriptor> RandomDescriptors(size_t count) {
  std::mt19937_64 random(5);
  std::vector<Descriptor> descriptors(count);
  for (Descriptor& descriptor : descriptors) {
    for (uint64_t& word : descriptor.words) word = random();
  }
  return descriptors;
}

TEST(DescriptorCodec, GivesBackDescriptorsOfImagesInLessThanHalfTheBytes) {
  const DescribedImage image = DescribeTexture();
  ASSERT_GT(image.descriptors.size(), 300u);
  const std::string bytes = EncodeDescriptors(image.descriptors, image.references);
  EXPECT_LT(bytes.size(), image.descriptors.size() * 16);
  const auto decoded = DecodeDescriptors(bytes, image.references);
  ASSERT_THAT(decoded, IsOk());
  EXPECT_TRUE(*decoded == image.descriptors);
}

TEST(DescriptorCodec, ReferencesHelp) {
  const DescribedImage image = DescribeTexture();
  const std::vector<DescriptorReferences> none(image.descriptors.size(), {-1, -1});
  EXPECT_LT(EncodeDescriptors(image.descriptors, image.references).size(),
            EncodeDescriptors(image.descriptors, none).size() * 9 / 10);
}

TEST(DescriptorCodec, GivesBackAnyBits) {
  for (const size_t count : {0, 1, 2, 500}) {
    std::vector<Descriptor> descriptors = RandomDescriptors(count);
    if (count == 2) descriptors = {Descriptor{}, Descriptor{{~0ull, ~0ull, ~0ull, ~0ull}}};
    std::vector<DescriptorReferences> references(count, {-1, -1});
    for (size_t i = 1; i < count; ++i) references[i] = {static_cast<int>(i) - 1, 0};
    const std::string bytes = EncodeDescriptors(descriptors, references);
    EXPECT_LE(bytes.size(), count * 40 + 80);
    const auto decoded = DecodeDescriptors(bytes, references);
    ASSERT_THAT(decoded, IsOk());
    EXPECT_TRUE(*decoded == descriptors);
  }
}

// The bytes are kept in databases: pattern, model and coder must never change.
TEST(DescriptorCodec, BytesAreTheSameForEver) {
  const BriefPair& first = BriefPattern()[0];
  const BriefPair& last = BriefPattern()[255];
  EXPECT_EQ((std::array{first.ax, first.ay, first.bx, first.by}), (std::array{5, 0, -8, -9}));
  EXPECT_EQ((std::array{last.ax, last.ay, last.bx, last.by}), (std::array{-4, -14, 4, -10}));
  const std::vector<Descriptor> descriptors = RandomDescriptors(40);
  std::vector<DescriptorReferences> references(40, {-1, -1});
  for (int i = 8; i < 40; ++i) references[static_cast<size_t>(i)] = {i - 1, i - 8};
  const std::string bytes = EncodeDescriptors(descriptors, references);
  EXPECT_EQ(bytes.size(), 1905u);
  EXPECT_EQ(Crc32c(bytes), 1077049272u);
}

TEST(DescriptorCodec, RefusesAnotherLength) {
  const std::vector<DescriptorReferences> references(20, {-1, -1});
  const std::string bytes = EncodeDescriptors(RandomDescriptors(20), references);
  const auto refused = StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("coded descriptors"));
  EXPECT_THAT(DecodeDescriptors(bytes + "x", references), refused);
  EXPECT_THAT(DecodeDescriptors(bytes.substr(0, bytes.size() / 2), references), refused);
  EXPECT_THAT(DecodeDescriptors("", references), refused);
  EXPECT_THAT(DecodeDescriptors(bytes, {}), refused);
}

TEST(DescriptorCodec, SurvivesNoise) {
  std::mt19937 random(6);
  const std::vector<DescriptorReferences> references(3, {-1, -1});
  for (int round = 0; round < 3000; ++round) {
    std::string noise(random() % 120, '\0');
    for (char& c : noise) c = static_cast<char>(random());
    const auto decoded = DecodeDescriptors(noise, references);
    if (decoded.ok()) {
      EXPECT_EQ(EncodeDescriptors(*decoded, references), noise);
    }
  }
}

}  // namespace
}  // namespace portolan
