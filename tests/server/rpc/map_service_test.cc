#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <future>

#include "tests/server/rpc/server_fixture.h"
#include "tests/server/support/generic_call.h"

namespace portolan {
namespace {

using google::protobuf::UnknownFieldSet;
using ::testing::ElementsAre;
using ::testing::IsSupersetOf;
using ::testing::SizeIs;

class MapServiceTest : public testing::ServerFixture {
 protected:
  // Agents a (4 submaps) and b (2), five landmarks each.
  void StartWithMap() {
    Start();
    for (const auto& [agent, last] : {std::pair("a", 3u), std::pair("b", 1u)}) {
      auto connection = Connect(agent);
      Upload(connection.get(), agent, 0, last);
      ASSERT_TRUE(connection->Finish().has_value());
    }
  }
};

TEST_F(MapServiceTest, InfoCounts) {
  StartWithMap();
  const auto info = client_->GetMapInfo();
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_EQ(info->map_version(), 6u);
  EXPECT_EQ(info->submap_count(), 6u);
  EXPECT_EQ(info->keyframe_count(), 12u);
  EXPECT_EQ(info->landmark_count(), 30u);
  EXPECT_EQ(info->agent_count(), 2u);
  EXPECT_GT(info->database_bytes(), 0u);
  ASSERT_EQ(info->components_size(), 1);
  EXPECT_THAT(info->components(0).agent_ids(), ElementsAre("a", "b"));
}

TEST_F(MapServiceTest, EmptyMapAnswersEverything) {
  Start();
  EXPECT_EQ(client_->GetMapInfo()->submap_count(), 0u);
  EXPECT_EQ(client_->ListAgents()->agents_size(), 0);
  EXPECT_EQ(client_->ListSubmaps({})->submaps_size(), 0);
  EXPECT_EQ(client_->GetPoseGraph({})->nodes_size(), 0);
  v1::QueryLandmarksRequest request;
  request.mutable_nearest()->mutable_point()->set_x(1);
  request.mutable_nearest()->set_count(3);
  EXPECT_EQ(client_->QueryLandmarks(request)->landmarks_size(), 0);
}

TEST_F(MapServiceTest, SubmapsCanBeFiltered) {
  StartWithMap();
  v1::ListSubmapsRequest request;
  EXPECT_THAT(client_->ListSubmaps(request)->submaps(), SizeIs(6));
  request.set_agent_id("b");
  const auto page = client_->ListSubmaps(request);
  ASSERT_THAT(page->submaps(), SizeIs(2));
  EXPECT_EQ(page->submaps(1).sequence_number(), 1u);
  EXPECT_EQ(page->submaps(1).link(), v1::LINK_TYPE_CONNECTED);
  EXPECT_EQ(page->submaps(1).encoded_bytes(), testing::MakeTestUpload("b", 1).submap().size());
  request.set_component_id(17);
  EXPECT_THAT(client_->ListSubmaps(request)->submaps(), SizeIs(0));
}

TEST_F(MapServiceTest, LandmarksNearAPointComeNearestFirst) {
  StartWithMap();
  v1::QueryLandmarksRequest request;
  request.mutable_nearest()->mutable_point()->set_x(60);  // submap 6, b's second
  request.mutable_nearest()->set_count(5);
  const auto page = client_->QueryLandmarks(request);
  ASSERT_TRUE(page.ok()) << page.status();
  EXPECT_EQ(page->component_id(), 1);
  ASSERT_THAT(page->landmarks(), SizeIs(5));
  double last = 0;
  for (const v1::Landmark& landmark : page->landmarks()) {
    const auto& p = landmark.point_in_world();
    const double distance = std::hypot(p.x() - 60, p.y(), p.z());
    EXPECT_GE(distance, last);
    last = distance;
    EXPECT_THAT(landmark.covariance(), SizeIs(6));
  }
  EXPECT_EQ(page->agent_ids(page->landmarks(0).agents(0)), "b");
}

TEST_F(MapServiceTest, BoxSphereLimitAndFilter) {
  StartWithMap();
  v1::QueryLandmarksRequest request;
  request.mutable_box()->mutable_min()->set_x(-1000);
  request.mutable_box()->mutable_min()->set_y(-1000);
  request.mutable_box()->mutable_min()->set_z(-1000);
  request.mutable_box()->mutable_max()->set_x(1000);
  request.mutable_box()->mutable_max()->set_y(1000);
  request.mutable_box()->mutable_max()->set_z(1000);
  EXPECT_THAT(client_->QueryLandmarks(request)->landmarks(), SizeIs(30));
  request.set_min_observation_count(4);  // one of five
  EXPECT_THAT(client_->QueryLandmarks(request)->landmarks(), SizeIs(6));
  request.set_limit(4);
  EXPECT_THAT(client_->QueryLandmarks(request)->landmarks(), SizeIs(4));
  request = {};
  request.mutable_sphere()->mutable_center()->set_x(30);
  request.mutable_sphere()->set_radius(1000);
  EXPECT_THAT(client_->QueryLandmarks(request)->landmarks(), SizeIs(30));
}

TEST_F(MapServiceTest, NonsenseIsInvalid) {
  StartWithMap();
  v1::QueryLandmarksRequest request;
  EXPECT_TRUE(absl::IsInvalidArgument(client_->QueryLandmarks(request).status()));
  request.mutable_nearest()->mutable_point()->set_x(std::nan(""));
  request.mutable_nearest()->set_count(1);
  EXPECT_TRUE(absl::IsInvalidArgument(client_->QueryLandmarks(request).status()));
  request.mutable_nearest()->mutable_point()->set_x(1);
  request.mutable_nearest()->set_count(0);
  EXPECT_TRUE(absl::IsInvalidArgument(client_->QueryLandmarks(request).status()));
  request.mutable_sphere()->set_radius(-1);
  EXPECT_TRUE(absl::IsInvalidArgument(client_->QueryLandmarks(request).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(client_->GetTrajectory({}).status()));
}

TEST_F(MapServiceTest, TrajectoryTellsSharedImagesOnce) {
  StartWithMap();
  v1::GetTrajectoryRequest request;
  request.set_agent_id("a");
  for (const auto& [kind, count] :
       {std::pair(v1::TRAJECTORY_KIND_KEYFRAMES, 5), std::pair(v1::TRAJECTORY_KIND_FRAMES, 9)}) {
    request.set_kind(kind);
    const auto segments = client_->GetTrajectory(request);
    ASSERT_TRUE(segments.ok()) << segments.status();
    EXPECT_THAT(*segments, SizeIs(4));
    std::vector<int64_t> times;
    for (const v1::TrajectorySegment& segment : *segments) {
      EXPECT_EQ(segment.world_from_camera_size(), 7 * segment.time_ns_size());
      times.insert(times.end(), segment.time_ns().begin(), segment.time_ns().end());
    }
    EXPECT_THAT(times, SizeIs(count));
    EXPECT_EQ(std::adjacent_find(times.begin(), times.end(), std::greater_equal<>()), times.end());
  }
  request.set_agent_id("nobody");
  EXPECT_THAT(*client_->GetTrajectory(request), SizeIs(0));
}

TEST_F(MapServiceTest, PoseGraphHasNodesAndLinks) {
  StartWithMap();
  const auto graph = client_->GetPoseGraph({});
  ASSERT_TRUE(graph.ok()) << graph.status();
  EXPECT_THAT(graph->nodes(), SizeIs(6));
  ASSERT_THAT(graph->edges(), SizeIs(4));
  EXPECT_EQ(graph->edges(0).kind(), v1::EDGE_KIND_LINK);
  EXPECT_EQ(graph->edges(0).submap_a(), 1);
  EXPECT_EQ(graph->edges(0).submap_b(), 2);
  EXPECT_THAT(graph->edges(0).information(), SizeIs(28));
}

TEST_F(MapServiceTest, FollowerHearsOfEveryChange) {
  Start();
  std::promise<void> told_of_three;
  std::set<int64_t> submaps;
  std::future<Status> follower = std::async(std::launch::async, [&] {
    return client_->FollowChanges(0, [&](const v1::MapChange& change) {
      for (const v1::SubmapInfo& submap : change.submaps()) submaps.insert(submap.submap_id());
      return submaps.size() < 3;
    });
  });
  auto agent = Connect("a");
  Upload(agent.get(), "a", 0, 2);
  EXPECT_TRUE(follower.get().ok());
  EXPECT_THAT(submaps, ElementsAre(1, 2, 3));
  // One who knows version 2 hears of what came later only.
  submaps.clear();
  Settle();
  ASSERT_TRUE(client_
                  ->FollowChanges(2,
                                  [&](const v1::MapChange& change) {
                                    for (const auto& s : change.submaps()) {
                                      submaps.insert(s.submap_id());
                                    }
                                    return false;
                                  })
                  .ok());
  EXPECT_THAT(submaps, ElementsAre(3));
}

TEST_F(MapServiceTest, SettleEndsWithItsDeadline) {
  probe_->SetBackgroundEndless(true);
  Start({}, {.has_background_work = true});
  auto agent = Connect("a");
  Upload(agent.get(), "a", 0, 0);
  EXPECT_TRUE(absl::IsDeadlineExceeded(client_->Settle(std::chrono::milliseconds(50)).status()));
  probe_->SetBackgroundEndless(false);
  EXPECT_TRUE(client_->Settle(std::chrono::seconds(30)).ok());
}

TEST_F(MapServiceTest, NoServerIsUnavailable) {
  const MapClient client("127.0.0.1:1", std::chrono::seconds(5));
  const Status status = client.GetMapInfo().status();
  EXPECT_TRUE(absl::IsUnavailable(status)) << status;
  EXPECT_THAT(std::string(status.message()), ::testing::HasSubstr("127.0.0.1:1"));
}

TEST_F(MapServiceTest, ReflectionListsTheServices) {
  Start();
  // ServerReflectionRequest.list_services = 7; ServerReflectionResponse.list_services_response = 6;
  // ListServiceResponse.service = 1; ServiceResponse.name = 1.
  UnknownFieldSet request;
  request.AddLengthDelimited(7)->assign("*");
  const auto response = testing::GenericCall(
      server_->address(), "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo",
      request);
  ASSERT_TRUE(response.ok()) << response.status();
  std::vector<std::string> names;
  for (int i = 0; i < (*response)->field_count(); ++i) {
    if ((*response)->field(i).number() != 6) continue;
    UnknownFieldSet list;
    ASSERT_TRUE(list.ParseFromString((*response)->field(i).length_delimited()));
    for (int k = 0; k < list.field_count(); ++k) {
      UnknownFieldSet service;
      ASSERT_TRUE(service.ParseFromString(list.field(k).length_delimited()));
      names.push_back(service.field(0).length_delimited());
    }
  }
  EXPECT_THAT(names, IsSupersetOf({"portolan.v1.AgentService", "portolan.v1.MapService",
                                   "grpc.health.v1.Health"}));
}

// HealthCheckRequest.service = 1; HealthCheckResponse.status = 1 (SERVING 1, NOT_SERVING 2).
uint64_t HealthOf(const std::string& address, const std::string& service) {
  UnknownFieldSet request;
  request.AddLengthDelimited(1)->assign(service);
  const auto response = testing::GenericCall(address, "/grpc.health.v1.Health/Check", request);
  if (!response.ok() || (*response)->field_count() != 1) return 0;
  return (*response)->field(0).varint();
}

TEST_F(MapServiceTest, HealthIsServing) {
  Start();
  EXPECT_EQ(HealthOf(server_->address(), ""), 1u);
  EXPECT_EQ(HealthOf(server_->address(), "portolan.v1.AgentService"), 1u);
}

}  // namespace
}  // namespace portolan
