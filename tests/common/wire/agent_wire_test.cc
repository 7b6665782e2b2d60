#include "common/wire/agent_wire.h"

#include <random>

#include "common/wire/submap_validation.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

using testing::HasSubstr;

SessionHello Hello() {
  SessionHello hello;
  hello.agent = AgentId("drone-1");
  hello.session = SessionId(77);
  hello.camera.width_px = 640;
  hello.camera.height_px = 480;
  hello.camera.fx_px = hello.camera.fy_px = 500;
  hello.software_version = "0.1.0";
  hello.received_map_version = 12;
  hello.offered_bytes_per_second = 300;
  return hello;
}

TEST(AgentWire, KeepsHello) {
  v1::Hello message;
  ToProto(Hello(), &message);
  const auto hello = FromProto(message);
  ASSERT_THAT(hello, IsOk());
  EXPECT_EQ(hello->agent, AgentId("drone-1"));
  EXPECT_EQ(hello->session, SessionId(77));
  EXPECT_EQ(hello->camera, Hello().camera);
  EXPECT_EQ(hello->software_version, "0.1.0");
  EXPECT_EQ(hello->received_map_version, 12u);
  EXPECT_EQ(hello->offered_bytes_per_second, 300u);
}

TEST(AgentWire, RefusesHelloOfAnotherVersionOrWithoutIdentity) {
  v1::Hello message;
  ToProto(Hello(), &message);
  message.set_protocol_version(3);
  EXPECT_THAT(FromProto(message),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("protocol_version: 3")));
  message.set_protocol_version(0);
  EXPECT_THAT(FromProto(message),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("protocol_version: 0")));
  message.set_protocol_version(1);
  message.set_session_id(0);
  EXPECT_THAT(FromProto(message),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("session_id")));
  message.set_session_id(1);
  message.set_agent_id("../etc");
  EXPECT_THAT(FromProto(message),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("agent_id")));
  message.set_agent_id("a");
  message.set_software_version(std::string(129, 'v'));
  EXPECT_THAT(FromProto(message),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("software_version")));
}

TEST(AgentWire, TakesHelloOfTheOldestVersion) {
  v1::Hello message;
  ToProto(Hello(), &message);
  EXPECT_EQ(message.protocol_version(), kProtocolVersion);
  message.set_protocol_version(kOldestProtocolVersion);
  const auto hello = FromProto(message);
  ASSERT_THAT(hello, IsOk());
  // What it is answered with depends on this.
  EXPECT_EQ(hello->protocol_version, kOldestProtocolVersion);
}

TEST(AgentWire, KeepsLivePoses) {
  LivePose pose;
  pose.time = Timestamp(123456789);
  pose.sequence_number = 5;
  pose.submap_from_camera = Rigid3::Exp(0.1 * Vector6d::Ones());
  v1::LivePose message;
  ToProto(pose, &message);
  auto value = FromProto(message);
  ASSERT_THAT(value, IsOk());
  EXPECT_EQ(value->time, pose.time);
  EXPECT_EQ(value->sequence_number, 5u);
  EXPECT_THAT(value->submap_from_camera, NearRigid(pose.submap_from_camera, 1e-6));
  EXPECT_FALSE(value->predecessor_from_submap.has_value());
  pose.predecessor_from_submap = Rigid3::Exp(-0.2 * Vector6d::Ones());
  message.Clear();
  ToProto(pose, &message);
  value = FromProto(message);
  ASSERT_THAT(value, IsOk());
  EXPECT_THAT(*value->predecessor_from_submap, NearRigid(*pose.predecessor_from_submap, 1e-6));
}

TEST(AgentWire, RefusesMalformedLivePoses) {
  v1::LivePose good;
  ToProto(LivePose(), &good);
  v1::LivePose message = good;
  message.mutable_submap_from_camera()->RemoveLast();
  EXPECT_THAT(FromProto(message), StatusIs(absl::StatusCode::kInvalidArgument));
  message = good;
  message.set_submap_from_camera(2, std::nanf(""));
  EXPECT_THAT(FromProto(message), StatusIs(absl::StatusCode::kInvalidArgument));
  message = good;
  message.add_predecessor_from_submap(1);
  EXPECT_THAT(FromProto(message), StatusIs(absl::StatusCode::kInvalidArgument));
  message = good;
  message.set_time_ns(-1);
  EXPECT_THAT(FromProto(message), StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST(AgentWire, ChecksUploads) {
  v1::SubmapUpload upload = MakeUpload(3, "some bytes");
  EXPECT_EQ(upload.sequence_number(), 3u);
  EXPECT_THAT(CheckUpload(upload), IsOk());
  (*upload.mutable_submap())[4] ^= 1;
  EXPECT_THAT(CheckUpload(upload),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("crc32c")));
  EXPECT_THAT(CheckUpload(MakeUpload(0, std::string(kMaxSubmapBytes + 1, 'x'))),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("more than")));
}

TEST(AgentWire, ChecksAcks) {
  v1::SubmapAck ack;
  EXPECT_FALSE(CheckAck(ack).ok());
  ack.set_verdict(v1::SUBMAP_VERDICT_ACCEPTED);
  EXPECT_THAT(CheckAck(ack), IsOk());
  ack.set_verdict(static_cast<v1::SubmapVerdict>(9));
  EXPECT_FALSE(CheckAck(ack).ok());
}

}  // namespace
}  // namespace portolan
