// The uplink against a real gRPC server in this process, with faults.
#include "agent/uplink/uplink_session.h"

#include <limits>

#include "agent/corrections/pose_corrector.h"
#include "common/wire/correction_wire.h"
#include "common/wire/geometry_wire.h"
#include "common/wire/submap_wire.h"
#include "tests/agent/uplink/fake_server.h"
#include "tests/agent/uplink/uplink_test_support.h"

namespace portolan {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::HasSubstr;

constexpr uint32_t kSubmaps = 12;

UplinkOptions FastOptions(const std::string& address) {
  UplinkOptions options;
  options.server_address = address;
  options.backoff.initial = milliseconds(2);
  options.backoff.max = milliseconds(20);
  options.connect_timeout = seconds(2);
  options.protocol.live_pose_interval = Duration::zero();
  return options;
}

class UplinkSessionTest : public testing::Test {
 protected:
  void StartSession(const std::string& address) {
    folder_ = outbox_->folder();
    auto session = UplinkSession::Create(FastOptions(address), std::move(outbox_), 1,
                                         [this](const MapCorrection& correction) {
                                           std::unique_lock lock(map_.mutex);
                                           corrections_.push_back(correction);
                                           corrector_.Apply(correction).IgnoreError();
                                           map_.changed.notify_all();
                                         });
    ASSERT_THAT(session, IsOk());
    session_ = *std::move(session);
    session_->Start();
  }
  void SubmitAll() {
    for (uint32_t n = 0; n < kSubmaps; ++n) ASSERT_THAT(session_->Submit(SmallSubmap(n)), IsOk());
  }
  // Every submap reached the server, as it was submitted, in order.
  void ExpectAllArrived() {
    std::unique_lock lock(map_.mutex);
    ASSERT_EQ(map_.submaps.size(), kSubmaps);
    for (const auto& [number, bytes] : map_.submaps) {
      EXPECT_EQ(bytes, *EncodeSubmap(SmallSubmap(number))) << number;
    }
  }
  void ExpectFinishes() {
    EXPECT_THAT(session_->Finish(seconds(30)), IsOk());
    EXPECT_EQ(session_->pending_submaps(), 0u);
    ExpectAllArrived();
  }

  const TempDir dir_;
  FakeMap map_;
  std::vector<MapCorrection> corrections_;  // guarded by map_.mutex
  PoseCorrector corrector_;
  std::unique_ptr<Outbox> outbox_ = NewOutbox(dir_);
  std::filesystem::path folder_;
  std::unique_ptr<UplinkSession> session_;
};

TEST_F(UplinkSessionTest, DeliversEverythingOnceInOrder) {
  FakeServer server(&map_, {});
  StartSession(server.address());
  SubmitAll();
  ExpectFinishes();
  std::vector<uint32_t> expected(kSubmaps);
  for (uint32_t n = 0; n < kSubmaps; ++n) expected[n] = n;
  EXPECT_EQ(map_.order, expected);
  EXPECT_FALSE(std::filesystem::exists(folder_));
  const UplinkStats stats = session_->stats();
  EXPECT_EQ(stats.accepted_submaps, kSubmaps);
  EXPECT_EQ(stats.streams, 1u);
  EXPECT_GT(stats.sent_bytes, kSubmaps * 1000u);
  EXPECT_GT(stats.received_bytes, kSubmaps * 14u);
  EXPECT_EQ(stats.last_error, "");
}

TEST_F(UplinkSessionTest, WorksWithoutAServerAndCatchesUp) {
  int port = 0;
  {
    FakeServer reserve(&map_, {});
    port = reserve.port();
  }
  StartSession("127.0.0.1:" + std::to_string(port));
  SubmitAll();
  EXPECT_THAT(session_->Finish(milliseconds(50)),
              StatusIs(absl::StatusCode::kDeadlineExceeded, HasSubstr("12 submaps")));
  FakeServer server(&map_, {}, port);
  ASSERT_EQ(server.port(), port);
  ExpectFinishes();
  EXPECT_GT(session_->stats().streams, 1u);
}

TEST_F(UplinkSessionTest, SurvivesAServerThatDiesInMidStream) {
  FakeServer server(&map_, {.die_after_uploads = 3});
  StartSession(server.address());
  SubmitAll();
  ExpectFinishes();
  EXPECT_GE(session_->stats().streams, 4u);
}

TEST_F(UplinkSessionTest, ResumesAfterTheServerRestarts) {
  auto server = std::make_unique<FakeServer>(&map_, FakeServer::Faults{.mute = true});
  const int port = server->port();
  StartSession(server->address());
  SubmitAll();
  ASSERT_TRUE(map_.Await([&] { return map_.submaps.size() >= 5; }));
  server.reset();
  server = std::make_unique<FakeServer>(&map_, FakeServer::Faults{}, port);
  ExpectFinishes();
  // What was committed before the restart was not sent again.
  for (const auto& [number, uploads] : map_.uploads) EXPECT_EQ(uploads, 1) << number;
}

TEST_F(UplinkSessionTest, AcceptsDuplicatedAndReorderedAcks) {
  FakeServer server(&map_, {.duplicate_acks = true, .reverse_acks = 4});
  StartSession(server.address());
  SubmitAll();
  ExpectFinishes();
  EXPECT_EQ(session_->stats().accepted_submaps, kSubmaps);
}

TEST_F(UplinkSessionTest, SetsRejectedSubmapsAsideAndGoesOn) {
  FakeServer server(&map_, {.rejected = {4}});
  StartSession(server.address());
  SubmitAll();
  EXPECT_THAT(session_->Finish(seconds(30)), IsOk());
  EXPECT_EQ(map_.uploads[4], 1);
  EXPECT_EQ(map_.submaps.size(), kSubmaps - 1);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "0000000004.submap.rejected"));
  EXPECT_THAT(session_->stats().last_error, HasSubstr("implausible"));
}

TEST_F(UplinkSessionTest, SetsAPoisonousSubmapAsideAndGoesOn) {
  FakeServer server(&map_, {.poison = {6}});
  StartSession(server.address());
  SubmitAll();
  EXPECT_THAT(session_->Finish(seconds(30)), IsOk());
  EXPECT_EQ(map_.submaps.size(), kSubmaps - 1);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "0000000006.submap.rejected"));
}

TEST_F(UplinkSessionTest, UploadsTheSessionOfAKilledProcess) {
  for (uint32_t n = 0; n < kSubmaps; ++n) {
    ASSERT_THAT(outbox_->Append(n, *EncodeSubmap(SmallSubmap(n))), IsOk());
  }
  outbox_.reset();
  const auto folders = Outbox::FindPendingSessions(dir_.path());
  ASSERT_EQ(folders.size(), 1u);
  outbox_ = *Outbox::Open(folders[0], OutboxOptions());
  FakeServer server(&map_, {});
  StartSession(server.address());
  ExpectFinishes();
}

// Garbage that a broken server might send.
std::vector<v1::ServerMessage> Garbage() {
  std::vector<v1::ServerMessage> messages(6);
  auto* nan = messages[0].mutable_correction()->add_submaps();
  nan->set_component_id(1);
  ToProto(Similarity3(), nan->mutable_world_from_submap());
  nan->mutable_world_from_submap()->mutable_translation()->set_x(
      std::numeric_limits<double>::quiet_NaN());
  auto* unknown = messages[1].mutable_correction()->add_submaps();
  unknown->set_sequence_number(4'000'000'000u);
  unknown->set_component_id(1);
  ToProto(Similarity3(), unknown->mutable_world_from_submap());
  for (int i = 0; i < 7; ++i) unknown->add_covariance_diagonal(1);
  messages[2].mutable_ack()->set_sequence_number(77);
  messages[2].mutable_ack()->set_verdict(v1::SUBMAP_VERDICT_ACCEPTED);
  messages[3].mutable_finished();
  messages[4].mutable_welcome()->set_next_sequence_number(5000);
  return messages;  // the last one is empty
}

TEST_F(UplinkSessionTest, SurvivesGarbageFromTheServer) {
  FakeServer server(&map_, {.after_welcome = Garbage(), .before_welcome = Garbage()});
  StartSession(server.address());
  SubmitAll();
  // The first Welcome is a lie, the true one comes second; everything arrives in spite of both.
  EXPECT_THAT(session_->Finish(seconds(30)), IsOk());
  ExpectAllArrived();
  EXPECT_GE(session_->stats().malformed_messages, 5u);
  EXPECT_FALSE(corrector_.Place(0, Rigid3()).in_world);
}

TEST_F(UplinkSessionTest, KeepsEverythingWhenWelcomeLies) {
  FakeServer server(&map_, {.welcome_next = 5000});
  StartSession(server.address());
  SubmitAll();
  ExpectFinishes();
}

TEST_F(UplinkSessionTest, HandsCorrectionsOn) {
  MapCorrection correction;
  correction.map_version = 17;
  correction.submaps.resize(1);
  correction.submaps[0].component = ComponentId(3);
  correction.submaps[0].world_from_submap.scale = 2;
  v1::ServerMessage message;
  ToProto(correction, kProtocolVersion, message.mutable_correction());
  corrector_.CloseSubmap(SmallSubmap(0));
  FakeServer server(&map_, {.die_after_uploads = 1, .after_welcome = {message}});
  StartSession(server.address());
  ASSERT_TRUE(map_.Await([&] { return !corrections_.empty(); }));
  EXPECT_EQ(corrections_[0].submaps[0].world_from_submap.scale, 2);
  EXPECT_TRUE(corrector_.Place(0, Rigid3()).in_world);
  // The next stream asks for what is newer.
  ASSERT_THAT(session_->Submit(SmallSubmap(0)), IsOk());
  ASSERT_TRUE(map_.Await([&] { return map_.hellos.size() >= 2; }));
  EXPECT_EQ(map_.hellos[0].received_map_version(), 0u);
  EXPECT_EQ(map_.hellos[1].received_map_version(), 17u);
}

TEST_F(UplinkSessionTest, SendsLivePoses) {
  FakeServer server(&map_, {});
  StartSession(server.address());
  LivePose pose;
  pose.time = seconds(5);
  pose.sequence_number = 2;
  session_->SetLivePose(pose);
  ASSERT_TRUE(map_.Await([&] { return !map_.live_poses.empty(); }));
  EXPECT_EQ(map_.live_poses[0].time_ns(), Duration(seconds(5)).count());
  EXPECT_EQ(map_.live_poses[0].sequence_number(), 2u);
}

TEST_F(UplinkSessionTest, ShutdownEndsEvenAMuteStream) {
  FakeServer server(&map_, {.mute = true});
  StartSession(server.address());
  SubmitAll();
  ASSERT_TRUE(map_.Await([&] { return map_.submaps.size() >= 8; }));
  session_->Shutdown();
  session_->Shutdown();
  EXPECT_EQ(session_->pending_submaps(), kSubmaps);
  EXPECT_THAT(session_->Finish(seconds(30)), StatusIs(absl::StatusCode::kCancelled));
}

TEST_F(UplinkSessionTest, RefusesForeignAndMalformedSubmaps) {
  StartSession("127.0.0.1:1");
  Submap foreign = SmallSubmap(0);
  foreign.key.session = SessionId(1);
  EXPECT_THAT(session_->Submit(foreign), StatusIs(absl::StatusCode::kInvalidArgument));
  Submap malformed = SmallSubmap(0);
  malformed.keyframes.clear();
  EXPECT_THAT(session_->Submit(malformed), StatusIs(absl::StatusCode::kInvalidArgument));
  EXPECT_EQ(session_->pending_submaps(), 0u);
}

TEST(UplinkOptions, ValidateNamesTheField) {
  EXPECT_THAT(UplinkOptions().Validate(), IsOk());
  const auto refuses = [](const char* what, auto change) {
    UplinkOptions options;
    change(&options);
    EXPECT_THAT(options.Validate(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  refuses("server_address", [](auto* o) { o->server_address.clear(); });
  refuses("window", [](auto* o) { o->protocol.window = 0; });
  refuses("max_invalid_ends", [](auto* o) { o->protocol.max_invalid_ends = 0; });
  refuses("live_pose", [](auto* o) { o->protocol.live_pose_interval = Duration(-1); });
  refuses("connect_timeout", [](auto* o) { o->connect_timeout = Duration::zero(); });
  refuses("keepalive_interval", [](auto* o) { o->keepalive_interval = seconds(1); });
  refuses("backoff", [](auto* o) { o->backoff.jitter = 2; });
}

}  // namespace
}  // namespace portolan
