#include "server/server.h"

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include <algorithm>
#include <unordered_set>
#include <utility>
#include <vector>

#include "common/base/concat.h"
#include "common/base/logging.h"
#include "common/wire/submap_wire.h"
#include "server/corrections/correction_dispatcher.h"
#include "server/ingest/session_table.h"
#include "server/pipeline/snapshot_hub.h"
#include "server/query/landmark_index.h"
#include "server/rpc/agent_service.h"
#include "server/rpc/map_service.h"
#include "server/store/sqlite_map_store.h"

namespace portolan {
namespace {

// gRPC's default; stated here because proto/README.md promises it.
constexpr int kMaxMessageBytes = 4 << 20;
constexpr auto kShutdownGrace = std::chrono::seconds(1);

// gRPC's plugins are switched on for the process, once.
void EnablePlugins() {
  static std::once_flag once;
  std::call_once(once, [] {
    grpc::EnableDefaultHealthCheckService(true);
    grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  });
}

int Milliseconds(Duration duration) {
  return static_cast<int>(std::chrono::duration_cast<std::chrono::milliseconds>(duration).count());
}

std::vector<SubmapInput> NotIn(const MapSnapshot* snapshot,
                               const std::vector<StoredSubmap>& submaps) {
  std::unordered_set<SubmapId> known;
  if (snapshot) {
    for (const auto& state : snapshot->submaps) known.insert(state->refined->id);
  }
  std::vector<SubmapInput> missing;
  for (const StoredSubmap& submap : submaps) {
    if (!known.contains(submap.id)) missing.push_back({submap.id, submap.submap, submap.camera});
  }
  return missing;
}

// Whether the newest session of an agent was not finished; they are in order of their creation.
bool HasUnfinishedAgent(const std::vector<SessionRecord>& sessions) {
  std::map<AgentId, bool> is_finished;
  for (const SessionRecord& session : sessions) is_finished[session.agent] = session.finished;
  return std::any_of(is_finished.begin(), is_finished.end(),
                     [](const auto& agent) { return !agent.second; });
}

}  // namespace

Status ServerOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(ingest.Validate());
  PORTOLAN_RETURN_IF_ERROR(map_thread.Validate());
  PORTOLAN_RETURN_IF_ERROR(corrections.Validate());
  PORTOLAN_RETURN_IF_ERROR(offers.Validate());
  if (max_agents < 1) return absl::InvalidArgumentError("max_agents must be positive");
  if (max_streams_per_connection < 1) {
    return absl::InvalidArgumentError("max_streams_per_connection must be positive");
  }
  if (keepalive_interval <= Duration::zero() || keepalive_timeout <= Duration::zero()) {
    return absl::InvalidArgumentError("the keepalive times must be positive");
  }
  return absl::OkStatus();
}

class Server::Impl {
 public:
  Impl(const ServerOptions& options, std::unique_ptr<MapStore> store)
      : options_(options),
        store_(std::move(store)),
        dispatcher_(options.corrections, options.offers, &hub_) {}

  ~Impl() { Shutdown(); }

  Status Start(std::unique_ptr<MapEngine> engine) {
    PORTOLAN_ASSIGN_OR_RETURN(std::vector<SubmapInput> backlog, Restore(engine.get()));
    MapThreadOptions map_thread_options = options_.map_thread;
    map_thread_options.lockstep |= !options_.ingest.lockstep_agents.empty();
    map_thread_ =
        std::make_unique<MapThread>(map_thread_options, std::move(engine), store_.get(), &hub_);
    ingest_ = std::make_unique<Ingest>(
        options_.ingest, store_.get(), &sessions_,
        [this](std::vector<SubmapInput> submaps) { map_thread_->Push(std::move(submaps)); },
        [this](const Status&) { SetServing(false); });
    survey_ =
        std::make_unique<SurveyBook>(std::move(stored_survey_), store_.get(), map_thread_.get());
    map_thread_->Start(std::move(backlog));
    dispatcher_.Start();
    ingest_->Start();
    return Listen();
  }

  void Shutdown() {
    if (is_shut_down_.exchange(true)) return;
    if (agent_service_) agent_service_->EndAll();
    if (grpc_) {
      grpc_->Shutdown(std::chrono::system_clock::now() + kShutdownGrace);
      grpc_->Wait();
    }
    dispatcher_.Shutdown();
    if (map_thread_) map_thread_->Shutdown();
    if (ingest_) ingest_->Shutdown();
  }

  std::string address() const {
    return Concat(options_.listen.substr(0, options_.listen.rfind(':')), ":", port_);
  }
  int port() const { return port_; }
  StageTimes stage_times() const { return map_thread_->stage_times(); }

 private:
  // Fills the session table and the engine; returns the submaps that the map lacks.
  StatusOr<std::vector<SubmapInput>> Restore(MapEngine* engine) {
    PORTOLAN_ASSIGN_OR_RETURN(StoredMap map, store_->Load(DecodeSubmap));
    PORTOLAN_RETURN_IF_ERROR(sessions_.Restore(map));
    if (!map.derived_problem.empty()) {
      LogWarning("the map is rebuilt from its raw submaps: ", map.derived_problem);
    }
    // A lockstep run that was broken off repeats what it had integrated: a map that is continued
    // from its stored form is as good, but not the same to the last bit.
    const bool is_broken_off =
        !options_.ingest.lockstep_agents.empty() && HasUnfinishedAgent(map.sessions);
    if (options_.rebuild || is_broken_off || !map.derived_problem.empty()) {
      PORTOLAN_RETURN_IF_ERROR(store_->DropDerived());
      // The versions go on, so that an agent that knows an old one is told what moved.
      auto empty = std::make_shared<MapSnapshot>();
      empty->closures = std::make_shared<const ClosureList>();
      if (map.snapshot) empty->version = map.snapshot->version;
      map.snapshot = std::move(empty);
    }
    std::vector<SubmapInput> backlog = NotIn(map.snapshot.get(), map.submaps);
    LogInfo("map: ", map.sessions.size(), " sessions, ", map.submaps.size(), " submaps, ",
            backlog.size(), " of them to integrate");
    if (map.snapshot) engine->Restore(std::move(map.snapshot));
    if (!map.survey.empty()) engine->SetSurvey(std::make_shared<const Survey>(map.survey));
    stored_survey_ = std::move(map.survey);
    return backlog;
  }

  Status Listen() {
    EnablePlugins();
    ServerContext context{
        &hub_,        store_.get(), &sessions_,    ingest_.get(),    map_thread_.get(),
        &dispatcher_, &landmarks_,  survey_.get(), PORTOLAN_VERSION, options_.max_agents};
    agent_service_ = std::make_unique<AgentServiceImpl>(context);
    map_service_ = std::make_unique<MapServiceImpl>(context);
    grpc::ServerBuilder builder;
    builder.AddListeningPort(options_.listen, grpc::InsecureServerCredentials(), &port_);
    builder.RegisterService(agent_service_.get());
    builder.RegisterService(map_service_.get());
    builder.SetMaxReceiveMessageSize(kMaxMessageBytes);
    // Two servers on one port would share the agents at random.
    builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
    builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS,
                               options_.max_streams_per_connection);
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS,
                               Milliseconds(options_.keepalive_interval));
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS,
                               Milliseconds(options_.keepalive_timeout));
    builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
    // Clients may ask for signs of life as well, down to this interval.
    builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, 5000);
    grpc_ = builder.BuildAndStart();
    if (!grpc_ || port_ == 0) {
      return absl::UnavailableError(Concat("cannot listen on ", options_.listen));
    }
    SetServing(true);
    return absl::OkStatus();
  }

  void SetServing(bool serving) {
    grpc::HealthCheckServiceInterface* health = grpc_ ? grpc_->GetHealthCheckService() : nullptr;
    if (!health) return;
    for (const char* service : {"", "portolan.v1.AgentService", "portolan.v1.MapService"}) {
      health->SetServingStatus(service, serving);
    }
  }

  const ServerOptions options_;
  const std::unique_ptr<MapStore> store_;
  SnapshotHub hub_;
  SessionTable sessions_;
  LandmarkIndexCache landmarks_;
  CorrectionDispatcher dispatcher_;
  std::unique_ptr<MapThread> map_thread_;
  std::unique_ptr<Ingest> ingest_;
  Survey stored_survey_;  // until it moves into the book
  std::unique_ptr<SurveyBook> survey_;
  std::unique_ptr<AgentServiceImpl> agent_service_;
  std::unique_ptr<MapServiceImpl> map_service_;
  std::unique_ptr<grpc::Server> grpc_;
  int port_ = 0;
  std::atomic<bool> is_shut_down_ = false;
};

Server::Server(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Server::~Server() = default;

StatusOr<std::unique_ptr<Server>> Server::Start(const ServerOptions& options,
                                                std::unique_ptr<MapEngine> engine) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  if (options.map_file.empty()) return absl::InvalidArgumentError("no map file is given");
  PORTOLAN_ASSIGN_OR_RETURN(std::unique_ptr<SqliteMapStore> store,
                            SqliteMapStore::Open(options.map_file));
  return Start(options, std::move(engine), std::move(store));
}

StatusOr<std::unique_ptr<Server>> Server::Start(const ServerOptions& options,
                                                std::unique_ptr<MapEngine> engine,
                                                std::unique_ptr<MapStore> store) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  auto impl = std::make_unique<Impl>(options, std::move(store));
  PORTOLAN_RETURN_IF_ERROR(impl->Start(std::move(engine)));
  return std::unique_ptr<Server>(new Server(std::move(impl)));
}

std::string Server::address() const { return impl_->address(); }
int Server::port() const { return impl_->port(); }
StageTimes Server::stage_times() const { return impl_->stage_times(); }
void Server::Shutdown() { impl_->Shutdown(); }

}  // namespace portolan
