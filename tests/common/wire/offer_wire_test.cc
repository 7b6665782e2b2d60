#include "common/wire/offer_wire.h"

#include <cmath>
#include <functional>
#include <random>

#include "common/wire/column_codec.h"
#include "common/wire/correction_wire.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

using testing::HasSubstr;

LandmarkOffer TestOffer(int landmarks) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(-1, 1);
  LandmarkOffer offer;
  offer.view = 0x1234567890;
  offer.component = ComponentId(3);
  Vector7d tangent;
  tangent << 1, 2, 3, 0.1, 0.2, -0.3, 0.4;
  offer.world_from_camera = Similarity3::Exp(tangent);
  offer.first_index = 7;
  for (int i = 0; i < landmarks; ++i) {
    OfferedLandmark landmark;
    const double depth = 3 + 2 * uniform(random);
    landmark.point_in_camera = {depth * uniform(random), depth * uniform(random), depth};
    landmark.lateral_sigma = 2e-3;
    landmark.depth_sigma = 0.02;
    for (uint64_t& word : landmark.descriptor.words) word = random();
    offer.landmarks.push_back(landmark);
  }
  return offer;
}

v1::LandmarkOffer OfferMessage(int landmarks) {
  v1::LandmarkOffer message;
  ToProto(TestOffer(landmarks), &message);
  return message;
}

TEST(OfferWire, KeepsOffers) {
  const LandmarkOffer offer = TestOffer(24);
  const auto value = FromProto(OfferMessage(24), "offer");
  ASSERT_THAT(value, IsOk());
  EXPECT_EQ(value->view, offer.view);
  EXPECT_EQ(value->component, offer.component);
  EXPECT_EQ(value->first_index, 7u);
  EXPECT_THAT(value->world_from_camera, NearSimilarity(offer.world_from_camera, 1e-12));
  ASSERT_EQ(value->landmarks.size(), 24u);
  for (size_t i = 0; i < 24; ++i) {
    const OfferedLandmark& expected = offer.landmarks[i];
    const OfferedLandmark& actual = value->landmarks[i];
    EXPECT_EQ(actual.descriptor, expected.descriptor);
    EXPECT_LT((actual.point_in_camera - expected.point_in_camera).norm(),
              2e-3 * expected.point_in_camera.norm());
    EXPECT_NEAR(std::log2(actual.depth_sigma / expected.depth_sigma), 0, 0.13);
    EXPECT_NEAR(std::log2(actual.lateral_sigma / expected.lateral_sigma), 0, 0.13);
  }
}

// Random descriptors, as these, take more than those of images.
TEST(OfferWire, TakesSevenBytesALandmarkBesidesItsDescriptor) {
  const v1::LandmarkOffer message = OfferMessage(24);
  EXPECT_LT(message.ByteSizeLong() - message.coded_descriptors().size(), 24u * 7 + 110u);
  EXPECT_LT(OfferMessage(0).ByteSizeLong(), 110u);
}

TEST(OfferWire, OnlyWhatTheWireHoldsIsSendable) {
  OfferedLandmark landmark = TestOffer(1).landmarks[0];
  EXPECT_TRUE(IsSendable(landmark));
  const auto is_refused = [&](const auto& spoil) {
    OfferedLandmark spoilt = landmark;
    spoil(&spoilt);
    return !IsSendable(spoilt);
  };
  EXPECT_TRUE(is_refused([](OfferedLandmark* l) { l->point_in_camera.z() = -1; }));
  EXPECT_TRUE(is_refused([](OfferedLandmark* l) { l->point_in_camera.z() = 1e-30; }));
  EXPECT_TRUE(is_refused([](OfferedLandmark* l) { l->point_in_camera.x() = 1e6; }));
  EXPECT_TRUE(is_refused([](OfferedLandmark* l) { l->point_in_camera.y() = std::nan(""); }));
  EXPECT_TRUE(is_refused([](OfferedLandmark* l) { l->depth_sigma = 0; }));
  EXPECT_TRUE(is_refused([](OfferedLandmark* l) { l->lateral_sigma = HUGE_VAL; }));
}

// Column of n numbers of which one is `value`.
std::string OfferColumn(size_t n, int64_t value) {
  std::vector<int64_t> values(n, 0);
  values.back() = value;
  return EncodeColumn(values);
}

TEST(OfferWire, RefusesMalformedOffersByName) {
  const auto refusal = [](const std::function<void(v1::LandmarkOffer*)>& spoil) {
    v1::LandmarkOffer message = OfferMessage(10);
    spoil(&message);
    const auto value = FromProto(message, "offer");
    EXPECT_TRUE(absl::IsInvalidArgument(value.status()));
    return std::string(value.status().message());
  };
  using M = v1::LandmarkOffer;
  EXPECT_THAT(refusal([](M* m) { m->set_view_id(0); }), HasSubstr("offer.view_id"));
  EXPECT_THAT(refusal([](M* m) { m->set_component_id(-1); }), HasSubstr("offer.component_id"));
  EXPECT_THAT(refusal([](M* m) { m->set_first_index(1 << 20); }), HasSubstr("offer.first_index"));
  EXPECT_THAT(refusal([](M* m) { m->set_count(4000000000u); }), HasSubstr("offer.count"));
  EXPECT_THAT(refusal([](M* m) { m->set_count(11); }), HasSubstr("offer.direction"));
  EXPECT_THAT(refusal([](M* m) { m->clear_depth(); }), HasSubstr("offer.depth"));
  EXPECT_THAT(refusal([](M* m) { m->set_depth(OfferColumn(10, INT64_MAX)); }),
              HasSubstr("offer.depth"));
  EXPECT_THAT(refusal([](M* m) { m->set_direction(OfferColumn(20, 1 << 17)); }),
              HasSubstr("offer.direction"));
  EXPECT_THAT(refusal([](M* m) { m->set_sigma(OfferColumn(20, 200)); }), HasSubstr("offer.sigma"));
  EXPECT_THAT(refusal([](M* m) { m->mutable_coded_descriptors()->resize(40); }),
              HasSubstr("offer.coded_descriptors"));
  EXPECT_THAT(refusal([](M* m) { m->mutable_world_from_camera()->set_scale(std::nan("")); }),
              HasSubstr("offer.world_from_camera"));
}

TEST(OfferWire, CorrectionsCarryOffersUpToALimit) {
  MapCorrection correction;
  correction.map_version = 4;
  correction.more = true;
  correction.offers.assign(kMaxOffersPerCorrection, TestOffer(1));
  v1::Correction message;
  ToProto(correction, 2, &message);
  const auto value = FromProto(message);
  ASSERT_THAT(value, IsOk());
  EXPECT_TRUE(value->more);
  EXPECT_EQ(value->offers.size(), kMaxOffersPerCorrection);
  *message.add_offers() = OfferMessage(1);
  EXPECT_THAT(std::string(FromProto(message).status().message()), HasSubstr("correction.offers"));
  message.clear_offers();
  message.add_offers();
  EXPECT_THAT(std::string(FromProto(message).status().message()),
              HasSubstr("correction.offers[0].view_id"));
}

TEST(OfferWire, SplitCorrectionsCarryTheOffersOnce) {
  MapCorrection correction;
  correction.submaps.resize(3);
  correction.offers.push_back(TestOffer(1));
  const std::vector<MapCorrection> parts = SplitCorrection(correction, 1);
  ASSERT_EQ(parts.size(), 3u);
  EXPECT_EQ(parts[0].offers.size(), 1u);
  EXPECT_TRUE(parts[1].offers.empty() && parts[2].offers.empty());
}

TEST(OfferWire, SurvivesRandomDamage) {
  const std::string bytes = OfferMessage(20).SerializeAsString();
  std::mt19937 random(4);
  int refused = 0;
  for (int round = 0; round < 5000; ++round) {
    std::string damaged = bytes;
    for (int hits = 1 + static_cast<int>(random() % 3); hits > 0; --hits) {
      damaged[random() % damaged.size()] = static_cast<char>(random());
    }
    v1::LandmarkOffer message;
    if (!message.ParseFromString(damaged)) continue;
    const auto offer = FromProto(message, "offer");
    refused += offer.ok() ? 0 : 1;
    if (!offer.ok()) continue;
    for (const OfferedLandmark& landmark : offer->landmarks) {
      EXPECT_TRUE(landmark.point_in_camera.allFinite());
      EXPECT_TRUE(landmark.point_in_camera.z() > 0 && landmark.depth_sigma > 0);
    }
  }
  EXPECT_GT(refused, 100);
}

}  // namespace
}  // namespace portolan
