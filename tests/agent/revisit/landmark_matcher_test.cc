#include "agent/revisit/landmark_matcher.h"

#include <random>

#include "agent/revisit/revisit_options.h"
#include "tests/agent/revisit/wall_scene.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

class LandmarkMatcherTest : public testing::Test {
 protected:
  LandmarkMatcherTest() {
    memory_.AddSubmap(scene_.MakeSubmap(0));
    memory_.Place(0, kWallWorld, kWallScale, scene_.Keyframes());
  }
  std::vector<KnownSight> Match(const std::vector<Feature>& features, uint32_t sequence_number = 5,
                                ComponentId component = kWallWorld) {
    return LandmarkMatcher({}, scene_.camera())
        .Match(memory_, component, sequence_number, believed_, features);
  }
  // Sights whose landmark is not where the pixel shows it from true_.
  int WrongOnes(const std::vector<KnownSight>& sights) const {
    int wrong = 0;
    for (const KnownSight& sight : sights) {
      const auto pixel = scene_.camera().Project(true_.Inverse() * sight.point_in_world);
      wrong += pixel && (*pixel - sight.pixel).norm() < 3 ? 0 : 1;
    }
    return wrong;
  }

  const WallScene scene_;
  LandmarkMemory memory_{{}, scene_.camera()};
  const Rigid3 true_{Eigen::Quaterniond(RotationExp({0.05, 0.1, 0.2})), {0.3, -0.2, -0.5}};
  // Some ten pixels off.
  const Rigid3 believed_ =
      true_ * Rigid3{Eigen::Quaterniond(RotationExp({0.01, -0.01, 0.01})), {0.06, 0.04, -0.05}};
};

TEST_F(LandmarkMatcherTest, FindsWhatIsInView) {
  const std::vector<KnownSight> sights = Match(scene_.Features(true_));
  EXPECT_GT(sights.size(), 25u);
  EXPECT_EQ(WrongOnes(sights), 0);
  for (const KnownSight& sight : sights)
    EXPECT_GE(sight.sigma_px, LandmarkMatcherOptions().sigma_px);
}

TEST_F(LandmarkMatcherTest, LeavesOutMatchesThatContradictTheRest) {
  std::vector<Feature> features = scene_.Features(true_);
  std::mt19937 random(2);
  std::uniform_real_distribution<float> off(-25, 25);
  for (size_t i = 0; i < features.size(); i += 3) {
    features[i].pixel += Eigen::Vector2f(off(random), off(random));
  }
  const std::vector<KnownSight> sights = Match(features);
  EXPECT_GT(sights.size(), 20u);
  EXPECT_LE(WrongOnes(sights), 1);
}

TEST_F(LandmarkMatcherTest, MatchesWithoutAgreementAreNone) {
  std::vector<Feature> features = scene_.Features(true_);
  std::mt19937 random(2);
  std::uniform_real_distribution<float> off(-30, 30);
  for (Feature& feature : features) feature.pixel += Eigen::Vector2f(off(random), off(random));
  EXPECT_TRUE(Match(features).empty());
}

TEST_F(LandmarkMatcherTest, MatchesInOneCornerAreNone) {
  std::vector<Feature> features = scene_.Features(true_);
  std::erase_if(features, [](const Feature& f) { return f.pixel.norm() > 320; });
  EXPECT_TRUE(Match(features).empty());
}

TEST_F(LandmarkMatcherTest, OtherDescriptorsMatchNothing) {
  std::vector<Feature> features = scene_.Features(true_);
  std::mt19937_64 random(2);
  for (Feature& feature : features) feature.descriptor.words[0] ^= random();
  EXPECT_FALSE(Match(features).empty());
  for (Feature& feature : features) {
    for (uint64_t& word : feature.descriptor.words) word = random();
  }
  EXPECT_TRUE(Match(features).empty());
}

TEST_F(LandmarkMatcherTest, NewestOwnSubmapsAndOtherWorldsAreLeftOut) {
  const std::vector<Feature> features = scene_.Features(true_);
  EXPECT_TRUE(Match(features, 1).empty());
  EXPECT_FALSE(Match(features, 2).empty());
  EXPECT_TRUE(Match(features, 5, ComponentId(2)).empty());
}

TEST_F(LandmarkMatcherTest, FindsOfferedLandmarksAtOnce) {
  memory_.AddOffer(scene_.MakeOffer(9, 0, kWallPoints));
  // The own submap is too new.
  const std::vector<KnownSight> sights = Match(scene_.Features(true_), 0);
  EXPECT_GT(sights.size(), 25u);
  EXPECT_EQ(WrongOnes(sights), 0);
  EXPECT_TRUE(sights.front().landmark.group.offered);
}

// What the wire lets through of a server that is mad.
TEST_F(LandmarkMatcherTest, AbsurdOffersAreHarmless) {
  LandmarkOffer offer = scene_.MakeOffer(9, 0, 40);
  for (size_t i = 0; i < offer.landmarks.size(); ++i) {
    offer.landmarks[i].point_in_camera *= std::exp2(i % 2 == 0 ? 59.0 : -59.0);
    offer.landmarks[i].depth_sigma = offer.landmarks[i].lateral_sigma = std::exp2(10);
  }
  offer.world_from_camera.scale = 1e9;
  memory_.AddOffer(offer);
  offer.view = 10;
  offer.world_from_camera.scale = 1e-9;
  offer.world_from_camera.translation = believed_.translation;
  memory_.AddOffer(offer);
  const std::vector<KnownSight> sights = Match(scene_.Features(true_));
  EXPECT_GT(sights.size(), 20u);
  EXPECT_EQ(WrongOnes(sights), 0);
}

TEST(RevisitOptions, RefusesWhatMakesNoSense) {
  RevisitOptions options;
  EXPECT_THAT(options.Validate(), IsOk());
  options.keyframe_interval = 0;
  EXPECT_FALSE(options.Validate().ok());
  options = RevisitOptions();
  options.offered_bytes_per_second = -1;
  EXPECT_FALSE(options.Validate().ok());
  options = RevisitOptions();
  options.matcher.search_radius_share = 0;
  EXPECT_FALSE(options.Validate().ok());
  options = RevisitOptions();
  options.memory.max_offered_views = 0;
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace portolan
