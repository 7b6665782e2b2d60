#include "agent/uplink/uplink_protocol.h"

#include "common/wire/correction_wire.h"
#include "common/wire/geometry_wire.h"
#include "tests/agent/uplink/uplink_test_support.h"

namespace portolan {
namespace {

using std::chrono::milliseconds;

v1::ServerMessage Welcome(uint32_t next) {
  v1::ServerMessage message;
  message.mutable_welcome()->set_next_sequence_number(next);
  return message;
}

v1::ServerMessage Ack(uint32_t number, v1::SubmapVerdict verdict = v1::SUBMAP_VERDICT_ACCEPTED) {
  v1::ServerMessage message;
  message.mutable_ack()->set_sequence_number(number);
  message.mutable_ack()->set_verdict(verdict);
  return message;
}

v1::ServerMessage Correction(uint64_t version, bool more) {
  v1::ServerMessage message;
  message.mutable_correction()->set_map_version(version);
  message.mutable_correction()->set_more(more);
  return message;
}

v1::ServerMessage BadCorrection(uint64_t version) {
  v1::ServerMessage message = Correction(version, false);
  message.mutable_correction()->add_submaps();
  return message;
}

class UplinkProtocolTest : public testing::Test {
 protected:
  void Fill(uint32_t count) {
    for (uint32_t n = 0; n < count; ++n) ASSERT_THAT(outbox_->Append(n, "bytes"), IsOk());
  }
  // Sequence numbers of the uploads that are due now.
  std::vector<uint32_t> Uploads() {
    std::vector<uint32_t> numbers;
    while (auto message = protocol_.Next(now_)) {
      if (message->has_submap()) numbers.push_back(message->submap().sequence_number());
    }
    return numbers;
  }

  const TempDir dir_;
  const std::unique_ptr<Outbox> outbox_ = NewOutbox(dir_);
  UplinkProtocol protocol_{outbox_.get(), {.window = 3, .max_invalid_ends = 2}};
  Duration now_ = std::chrono::seconds(1);
};

TEST_F(UplinkProtocolTest, SaysNothingBeforeWelcome) {
  Fill(1);
  protocol_.SetLivePose(LivePose());
  EXPECT_TRUE(protocol_.StartStream().has_hello());
  EXPECT_EQ(protocol_.Next(now_), std::nullopt);
  protocol_.OnMessage(Ack(0));
  EXPECT_EQ(protocol_.stats().malformed_messages, 1u);
  EXPECT_EQ(outbox_->pending_count(), 1u);
}

TEST_F(UplinkProtocolTest, KeepsTheWindow) {
  Fill(5);
  protocol_.StartStream();
  protocol_.OnMessage(Welcome(0));
  EXPECT_THAT(Uploads(), testing::ElementsAre(0, 1, 2));
  protocol_.OnMessage(Ack(1));
  EXPECT_THAT(Uploads(), testing::ElementsAre(3));
  protocol_.OnMessage(Ack(0));
  protocol_.OnMessage(Ack(0));
  EXPECT_THAT(Uploads(), testing::ElementsAre(4));
  EXPECT_EQ(protocol_.stats().accepted_submaps, 2u);
}

TEST_F(UplinkProtocolTest, ResumesWhereTheServerIs) {
  Fill(4);
  protocol_.StartStream();
  protocol_.OnMessage(Welcome(0));
  Uploads();
  protocol_.StreamEnded(absl::UnavailableError("broken"));
  protocol_.StartStream();
  protocol_.OnMessage(Welcome(2));
  EXPECT_THAT(Uploads(), testing::ElementsAre(2, 3));
  EXPECT_EQ(outbox_->pending_count(), 2u);
}

TEST_F(UplinkProtocolTest, DoesNotBelieveAWelcomeBeyondTheSession) {
  Fill(2);
  protocol_.StartStream();
  protocol_.OnMessage(Welcome(3));
  EXPECT_EQ(outbox_->pending_count(), 2u);
  EXPECT_THAT(Uploads(), testing::ElementsAre(0, 1));
}

TEST_F(UplinkProtocolTest, IgnoresAcksOfSubmapsThatWereNotSent) {
  Fill(5);
  protocol_.StartStream();
  protocol_.OnMessage(Welcome(0));
  Uploads();
  protocol_.OnMessage(Ack(4));
  protocol_.OnMessage(Ack(4'000'000'000u));
  protocol_.OnMessage(Ack(1, v1::SUBMAP_VERDICT_UNSPECIFIED));
  EXPECT_EQ(outbox_->pending_count(), 5u);
}

TEST_F(UplinkProtocolTest, SetsRejectedSubmapsAside) {
  Fill(2);
  protocol_.StartStream();
  protocol_.OnMessage(Welcome(0));
  Uploads();
  protocol_.OnMessage(Ack(0, v1::SUBMAP_VERDICT_REJECTED));
  EXPECT_FALSE(outbox_->IsPending(0));
  EXPECT_TRUE(std::filesystem::exists(outbox_->folder() / "0000000000.submap.rejected"));
  EXPECT_EQ(protocol_.stats().rejected_submaps, 1u);
}

TEST_F(UplinkProtocolTest, SetsASubmapAsideThatEndsEveryStream) {
  Fill(2);
  for (int i = 0; i < 2; ++i) {
    EXPECT_TRUE(outbox_->IsPending(0));
    protocol_.StartStream();
    protocol_.OnMessage(Welcome(0));
    Uploads();
    protocol_.StreamEnded(absl::InvalidArgumentError("poison"));
  }
  EXPECT_FALSE(outbox_->IsPending(0));
  EXPECT_TRUE(outbox_->IsPending(1));
}

TEST_F(UplinkProtocolTest, LimitsTheRateOfLivePosesAndSendsTheNewest) {
  protocol_.StartStream();
  protocol_.OnMessage(Welcome(0));
  LivePose pose;
  for (int i = 0; i < 100; ++i) {
    pose.time = milliseconds(10 * i);
    protocol_.SetLivePose(pose);
    const auto message = protocol_.Next(now_ + milliseconds(10 * i));
    EXPECT_EQ(message.has_value(), i % 10 == 0) << i;
    if (message.has_value()) {
      EXPECT_EQ(message->live_pose().time_ns(), pose.time.count());
    }
  }
  EXPECT_EQ(protocol_.NextDue(), now_ + milliseconds(1000));
}

TEST_F(UplinkProtocolTest, DropsInvalidLivePoses) {
  protocol_.StartStream();
  protocol_.OnMessage(Welcome(0));
  LivePose pose;
  pose.submap_from_camera.translation.x() = std::nan("");
  protocol_.SetLivePose(pose);
  EXPECT_EQ(protocol_.Next(now_), std::nullopt);
}

TEST_F(UplinkProtocolTest, AsksForOffersOnlyIfTheyAreWanted) {
  EXPECT_EQ(protocol_.StartStream().hello().offered_bytes_per_second(), 0u);
  UplinkProtocol wants(outbox_.get(), {.offered_bytes_per_second = 400});
  EXPECT_EQ(wants.StartStream().hello().offered_bytes_per_second(), 400u);
}

TEST_F(UplinkProtocolTest, OffersAreHandedOnAndDamagedOnesNamed) {
  protocol_.StartStream();
  protocol_.OnMessage(Welcome(0));
  v1::ServerMessage message = Correction(4, true);
  v1::LandmarkOffer* offer = message.mutable_correction()->add_offers();
  offer->set_view_id(5);
  offer->set_component_id(1);
  ToProto(Similarity3(), offer->mutable_world_from_camera());
  const auto correction = protocol_.OnMessage(message);
  ASSERT_TRUE(correction.has_value());
  ASSERT_EQ(correction->offers.size(), 1u);
  EXPECT_EQ(correction->offers[0].view, 5u);
  // Offers alone say nothing of the version's placements.
  EXPECT_EQ(protocol_.stats().received_map_version, 0u);
  offer->set_count(1u << 31);
  EXPECT_FALSE(protocol_.OnMessage(message).has_value());
  EXPECT_EQ(protocol_.stats().malformed_messages, 1u);
  EXPECT_THAT(protocol_.stats().last_error, testing::HasSubstr("correction.offers[0].count"));
}

TEST_F(UplinkProtocolTest, ResumesCorrectionsAfterTheLastCompleteVersion) {
  protocol_.StartStream();
  protocol_.OnMessage(Welcome(0));
  EXPECT_TRUE(protocol_.OnMessage(Correction(4, false)).has_value());
  EXPECT_TRUE(protocol_.OnMessage(Correction(5, true)).has_value());
  EXPECT_EQ(protocol_.StartStream().hello().received_map_version(), 4u);
  protocol_.OnMessage(Welcome(0));
  EXPECT_FALSE(protocol_.OnMessage(BadCorrection(6)).has_value());
  EXPECT_TRUE(protocol_.OnMessage(Correction(7, false)).has_value());
  EXPECT_EQ(protocol_.StartStream().hello().received_map_version(), 4u);
  protocol_.OnMessage(Welcome(0));
  protocol_.OnMessage(Correction(8, false));
  EXPECT_EQ(protocol_.StartStream().hello().received_map_version(), 8u);
}

TEST_F(UplinkProtocolTest, SendsFinishWhenNothingIsPending) {
  Fill(1);
  protocol_.RequestFinish();
  protocol_.StartStream();
  protocol_.OnMessage(Welcome(0));
  EXPECT_THAT(Uploads(), testing::ElementsAre(0));
  v1::ServerMessage finished;
  finished.mutable_finished();
  protocol_.OnMessage(finished);
  EXPECT_FALSE(protocol_.finished()) << "Finish was not sent yet";
  protocol_.OnMessage(Ack(0));
  const auto message = protocol_.Next(now_);
  ASSERT_TRUE(message.has_value() && message->has_finish());
  EXPECT_EQ(protocol_.Next(now_), std::nullopt);
  protocol_.OnMessage(finished);
  EXPECT_TRUE(protocol_.finished());
}

TEST_F(UplinkProtocolTest, ASubmapAfterFinishKeepsTheSessionOpen) {
  protocol_.RequestFinish();
  protocol_.StartStream();
  protocol_.OnMessage(Welcome(0));
  ASSERT_TRUE(protocol_.Next(now_)->has_finish());
  Fill(1);
  v1::ServerMessage finished;
  finished.mutable_finished();
  protocol_.OnMessage(finished);
  EXPECT_FALSE(protocol_.finished());
}

TEST_F(UplinkProtocolTest, CountsDamagedFilesAndGoesOn) {
  Fill(3);
  std::filesystem::resize_file(outbox_->folder() / "0000000001.submap", 21);
  protocol_.StartStream();
  protocol_.OnMessage(Welcome(0));
  EXPECT_THAT(Uploads(), testing::ElementsAre(0, 2));
  EXPECT_EQ(protocol_.stats().corrupted_submaps, 1u);
}

TEST(WireBytes, AddsFraming) {
  EXPECT_EQ(WireBytes(0), 5u + 9u);
  EXPECT_EQ(WireBytes(40000), 40005u + 3 * 9u);
}

}  // namespace
}  // namespace portolan
