// Landmark queries in a map of 1,000,000 landmarks (5,000 submaps of 200): directly and over gRPC.
// Targets: 1,000 landmarks in a box under 10 ms, the nearest 10 under 2 ms, over gRPC.
#include <benchmark/benchmark.h>
#include <grpcpp/grpcpp.h>

#include <memory>
#include <random>

#include "common/client/map_client.h"
#include "server/rpc/map_service.h"

namespace portolan {
namespace {

constexpr int kSubmaps = 5000;
constexpr int kLandmarksPerSubmap = 200;
constexpr double kWorld = 200;  // submaps lie in a square of this size
constexpr double kSubmap = 4;   // standard deviation of a submap's landmarks
// Edge of a cube that holds about 1,000 landmarks in the middle of the world.
constexpr double kBox = 7.7;

std::shared_ptr<const SubmapState> MakeState(int64_t id, std::mt19937* random) {
  std::uniform_real_distribution<double> uniform(0, kWorld);
  std::normal_distribution<double> normal(0, kSubmap);
  const Eigen::Vector3d center(uniform(*random), uniform(*random), 0);
  auto raw = std::make_shared<Submap>();
  raw->key = {AgentId("agent" + std::to_string(id % 100)), SessionId(1),
              static_cast<uint32_t>(id / 100)};
  auto refined = std::make_shared<RefinedSubmap>();
  refined->id = SubmapId(id);
  refined->raw = std::move(raw);
  auto state = std::make_shared<SubmapState>();
  state->refined = std::move(refined);
  state->component = ComponentId(1);
  for (int i = 0; i < kLandmarksPerSubmap; ++i) {
    const LandmarkSight sight{SubmapId(id), TrackId(i)};
    state->landmarks.push_back(
        {LandmarkIdOf(sight),
         center + Eigen::Vector3d(normal(*random), normal(*random), normal(*random)),
         Symmetric3(),
         5,
         {sight}});
  }
  return state;
}

std::shared_ptr<const MapSnapshot> MakeMap() {
  std::mt19937 random(1);
  auto snapshot = std::make_shared<MapSnapshot>();
  snapshot->version = 1;
  for (int64_t id = 1; id <= kSubmaps; ++id) snapshot->submaps.push_back(MakeState(id, &random));
  snapshot->components = {{ComponentId(1), true, false}};
  snapshot->closures = std::make_shared<const ClosureList>();
  return snapshot;
}

const std::shared_ptr<const MapSnapshot>& Map() {
  static const auto map = MakeMap();
  return map;
}

// A server with the map service only, and its client.
class ServedMap {
 public:
  ServedMap() {
    hub_.Publish(Map());
    context_.hub = &hub_;
    context_.sessions = &sessions_;
    context_.landmarks = &landmarks_;
    service_ = std::make_unique<MapServiceImpl>(context_);
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(service_.get());
    server_ = builder.BuildAndStart();
    client_ = std::make_unique<MapClient>("127.0.0.1:" + std::to_string(port));
  }
  const MapClient& client() const { return *client_; }

  static ServedMap& Get() {
    static ServedMap map;
    return map;
  }

 private:
  SnapshotHub hub_;
  SessionTable sessions_;
  LandmarkIndexCache landmarks_;
  ServerContext context_;
  std::unique_ptr<MapServiceImpl> service_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<MapClient> client_;
};

Eigen::Vector3d DrawPoint(std::mt19937* random) {
  std::uniform_real_distribution<double> uniform(20, kWorld - 20);
  return {uniform(*random), uniform(*random), 0};
}

void Set(const Eigen::Vector3d& point, v1::Vector3* message) {
  message->set_x(point.x());
  message->set_y(point.y());
  message->set_z(point.z());
}

void BM_BoxDirect(benchmark::State& state) {
  const auto index = LandmarkIndex::Build(Map(), nullptr);
  std::mt19937 random(2);
  size_t found = 0;
  for (auto _ : state) {
    const Eigen::Vector3d center = DrawPoint(&random);
    const Eigen::Vector3d half = Eigen::Vector3d::Constant(kBox / 2);
    found += index->InBox(ComponentId(1), center - half, center + half).size();
  }
  state.counters["results"] = static_cast<double>(found) / static_cast<double>(state.iterations());
}
BENCHMARK(BM_BoxDirect)->Unit(benchmark::kMicrosecond);

void BM_NearestDirect(benchmark::State& state) {
  const auto index = LandmarkIndex::Build(Map(), nullptr);
  std::mt19937 random(3);
  for (auto _ : state) {
    benchmark::DoNotOptimize(index->Nearest(ComponentId(1), DrawPoint(&random), 10));
  }
}
BENCHMARK(BM_NearestDirect)->Unit(benchmark::kMicrosecond);

void BM_BoxOverGrpc(benchmark::State& state) {
  const MapClient& client = ServedMap::Get().client();
  std::mt19937 random(2);
  int64_t found = 0;
  for (auto _ : state) {
    const Eigen::Vector3d center = DrawPoint(&random);
    const Eigen::Vector3d half = Eigen::Vector3d::Constant(kBox / 2);
    v1::QueryLandmarksRequest request;
    Set(center - half, request.mutable_box()->mutable_min());
    Set(center + half, request.mutable_box()->mutable_max());
    const auto page = client.QueryLandmarks(request);
    if (!page.ok()) return state.SkipWithError("query failed");
    found += page->landmarks_size();
  }
  state.counters["results"] = static_cast<double>(found) / static_cast<double>(state.iterations());
}
BENCHMARK(BM_BoxOverGrpc)->Unit(benchmark::kMillisecond)->UseRealTime();

void BM_NearestOverGrpc(benchmark::State& state) {
  const MapClient& client = ServedMap::Get().client();
  std::mt19937 random(3);
  for (auto _ : state) {
    v1::QueryLandmarksRequest request;
    Set(DrawPoint(&random), request.mutable_nearest()->mutable_point());
    request.mutable_nearest()->set_count(10);
    if (!client.QueryLandmarks(request).ok()) return state.SkipWithError("query failed");
  }
}
BENCHMARK(BM_NearestOverGrpc)->Unit(benchmark::kMillisecond)->UseRealTime();

// Indexing a new version in which `changed` submaps were replaced.
void BM_IndexNewVersion(benchmark::State& state) {
  const auto index = LandmarkIndex::Build(Map(), nullptr);
  std::mt19937 random(4);
  auto next = std::make_shared<MapSnapshot>(*Map());
  for (int64_t i = 0; i < state.range(0); ++i) next->submaps[i] = MakeState(i + 1, &random);
  for (auto _ : state) benchmark::DoNotOptimize(LandmarkIndex::Build(next, index.get()));
}
BENCHMARK(BM_IndexNewVersion)->Arg(10)->Arg(kSubmaps)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace portolan

BENCHMARK_MAIN();
