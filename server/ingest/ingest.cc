#include "server/ingest/ingest.h"

#include <algorithm>
#include <set>
#include <utility>

#include "common/base/concat.h"
#include "common/base/logging.h"
#include "common/wire/submap_wire.h"

namespace portolan {
namespace {

SessionName SessionOf(const SubmapKey& key) { return {key.agent, key.session}; }

Status Stopping() { return absl::UnavailableError("the server stops"); }

}  // namespace

Status IngestOptions::Validate() const {
  if (max_group < 1) return absl::InvalidArgumentError("max_group must be positive");
  if (std::set<AgentId>(lockstep_agents.begin(), lockstep_agents.end()).size() !=
      lockstep_agents.size()) {
    return absl::InvalidArgumentError("an agent is named twice in lockstep_agents");
  }
  return absl::OkStatus();
}

Ingest::Ingest(const IngestOptions& options, MapStore* store, SessionTable* sessions, Sink sink,
               FailureCallback on_store_failure)
    : options_(options),
      store_(store),
      sessions_(sessions),
      sink_(std::move(sink)),
      on_store_failure_(std::move(on_store_failure)),
      schedule_(options.lockstep_agents) {
  RestoreSchedule();
}

Ingest::~Ingest() { Shutdown(); }

// After a restart in mid run, agents whose newest session is finished are not waited for. When no
// declared agent has an unfinished session, a new run begins and all are waited for.
void Ingest::RestoreSchedule() {
  bool in_mid_run = false;
  for (const SessionStatus& session : sessions_->List()) {  // an agent's newest session comes last
    const AgentId& agent = session.name.agent;
    schedule_.Resume(agent, session.finished ? 0 : session.next_sequence_number);
    if (session.finished) schedule_.Finish(agent);
    in_mid_run |= !session.finished && schedule_.IsDeclared(agent);
  }
  if (in_mid_run) return;
  for (const AgentId& agent : options_.lockstep_agents) schedule_.Resume(agent, 0);
}

void Ingest::Start() {
  thread_ = std::thread([this] { Run(); });
}

StatusOr<uint32_t> Ingest::OpenSession(const SessionHello& hello) {
  PORTOLAN_ASSIGN_OR_RETURN(CameraModel camera, CameraModel::Create(hello.camera));
  const SessionName name{hello.agent, hello.session};
  {
    const std::lock_guard lock(mutex_);
    if (schedule_.enabled() && !schedule_.IsDeclared(hello.agent)) {
      return absl::FailedPreconditionError(
          Concat("agent ", hello.agent.value(), " is not among the lockstep agents"));
    }
  }
  const std::optional<SessionStatus> known = sessions_->Find(name);
  if (known && known->camera->intrinsics() != hello.camera) {
    return absl::FailedPreconditionError(Concat("session ", hello.session.value(), " of agent ",
                                                hello.agent.value(),
                                                " is known with another camera calibration"));
  }
  const Status added = store_->AddSession({hello.agent, hello.session, hello.camera, false});
  if (!added.ok()) return absl::UnavailableError(added.message());
  sessions_->Add(name, std::make_shared<const CameraModel>(std::move(camera)));
  const SessionStatus session = *sessions_->Find(name);
  const std::lock_guard lock(mutex_);
  if (!session.finished) schedule_.Resume(hello.agent, session.next_sequence_number);
  return session.next_sequence_number;
}

StatusOr<Ingest::Pending> Ingest::Judge(const SessionName& session,
                                        const v1::SubmapUpload& upload) const {
  PORTOLAN_RETURN_IF_ERROR(CheckUpload(upload));
  PORTOLAN_ASSIGN_OR_RETURN(Submap submap, DecodeSubmap(upload.submap()));
  const SubmapKey key{session.agent, session.session, upload.sequence_number()};
  if (submap.key != key) {
    return absl::InvalidArgumentError("the submap's name is not that of its upload and session");
  }
  const std::optional<SessionStatus> status = sessions_->Find(session);
  if (!status) return absl::InvalidArgumentError("unknown session");
  if (status->finished && !sessions_->IsCommitted(key)) {
    return absl::InvalidArgumentError("the session is finished");
  }
  return Pending{key, upload.submap(), std::make_shared<const Submap>(std::move(submap)),
                 status->camera, nullptr};
}

void Ingest::Submit(const SessionName& session, const v1::SubmapUpload& upload,
                    VerdictCallback done) {
  StatusOr<Pending> pending = Judge(session, upload);
  if (!pending.ok()) {
    LogWarning("rejected submap ", upload.sequence_number(), " of agent ", session.agent.value(),
               ": ", pending.status().message());
    sessions_->AddRejected({session.agent, session.session, upload.sequence_number()});
    done(IngestVerdict{false, std::string(pending.status().message())});
    return;
  }
  pending->done = std::move(done);
  std::unique_lock lock(mutex_);
  if (stop_) {
    lock.unlock();
    pending->done(Stopping());
    return;
  }
  // What the session sent on a stream before: each connection would leave one behind, and the
  // verdict belongs to the newest.
  const auto older = std::find_if(pending_.begin(), pending_.end(), [&](const Pending& other) {
    return SessionOf(other.key) == session;
  });
  VerdictCallback replaced;
  if (older != pending_.end()) {
    replaced = std::move(older->done);
    pending_.erase(older);
  }
  pending_.push_back(*std::move(pending));
  wake_.notify_one();
  lock.unlock();
  if (replaced) replaced(absl::UnavailableError("the session sent a submap on another stream"));
}

void Ingest::FinishSession(const SessionName& session, std::function<void(Status)> done) {
  const Status status = store_->FinishSession(session.agent, session.session);
  if (!status.ok()) return done(absl::UnavailableError(status.message()));
  sessions_->SetFinished(session);
  std::vector<std::function<void(Status)>> ready;
  {
    const std::lock_guard lock(mutex_);
    schedule_.Finish(session.agent);
    finish_waiters_.push_back(std::move(done));
    if (!schedule_.enabled() || schedule_.AllFinished()) ready = std::exchange(finish_waiters_, {});
    wake_.notify_one();
  }
  for (const auto& waiter : ready) waiter(absl::OkStatus());
}

void Ingest::Shutdown() {
  std::deque<Pending> left;
  std::vector<std::function<void(Status)>> waiters;
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
    left = std::exchange(pending_, {});
    waiters = std::exchange(finish_waiters_, {});
    wake_.notify_one();
  }
  if (thread_.joinable()) thread_.join();
  for (const Pending& pending : left) pending.done(Stopping());
  for (const auto& waiter : waiters) waiter(Stopping());
}

void Ingest::Run() {
  std::unique_lock lock(mutex_);
  while (!stop_) {
    std::vector<Pending> group = TakeGroup();
    if (group.empty()) {
      wake_.wait(lock);
      continue;
    }
    lock.unlock();
    Commit(std::move(group));
    lock.lock();
  }
}

std::vector<Ingest::Pending> Ingest::TakeGroup() {
  std::vector<Pending> group;
  if (!schedule_.enabled()) {
    while (!pending_.empty() && group.size() < static_cast<size_t>(options_.max_group)) {
      group.push_back(std::move(pending_.front()));
      pending_.pop_front();
    }
    return group;
  }
  const std::optional<AgentId> turn = schedule_.Turn();
  for (auto pending = pending_.begin(); turn && pending != pending_.end(); ++pending) {
    if (pending->key.agent != *turn) continue;
    group.push_back(std::move(*pending));
    pending_.erase(pending);
    break;
  }
  return group;
}

std::vector<Ingest::Pending> Ingest::AnswerDuplicates(std::vector<Pending> group) {
  std::vector<Pending> fresh;
  for (Pending& pending : group) {
    const uint32_t next = sessions_->Find(SessionOf(pending.key))->next_sequence_number;
    if (sessions_->IsCommitted(pending.key)) {
      pending.done(IngestVerdict{true, ""});
    } else if (pending.key.sequence_number < next) {
      pending.done(IngestVerdict{false, "a later submap of the session came before"});
    } else {
      fresh.push_back(std::move(pending));
    }
  }
  return fresh;
}

void Ingest::Commit(std::vector<Pending> group) {
  group = AnswerDuplicates(std::move(group));
  if (group.empty()) return;
  std::vector<NewSubmap> submaps;
  for (Pending& pending : group) submaps.push_back({pending.key, std::move(pending.bytes)});
  const StatusOr<std::vector<SubmapId>> ids = store_->AppendSubmaps(submaps);
  if (!ids.ok()) {
    LogError("commit failed: ", ids.status().ToString());
    if (on_store_failure_) on_store_failure_(ids.status());
    for (const Pending& pending : group) {
      pending.done(absl::UnavailableError("the map store takes no writes"));
    }
    return;
  }
  std::vector<SubmapInput> inputs;
  for (size_t i = 0; i < group.size(); ++i) {
    const Pending& pending = group[i];
    sessions_->AddCommitted(pending.key, (*ids)[i], submaps[i].bytes.size());
    inputs.push_back({(*ids)[i], pending.submap, pending.camera});
  }
  {
    const std::lock_guard lock(mutex_);
    for (const Pending& pending : group) {
      schedule_.Resume(pending.key.agent, pending.key.sequence_number + 1);
    }
  }
  // First into the map's queue, then the verdicts: who settles after a verdict finds the submap.
  sink_(std::move(inputs));
  for (const Pending& pending : group) pending.done(IngestVerdict{true, ""});
}

}  // namespace portolan
