#include "server/corrections/correction_dispatcher.h"

#include <utility>

namespace portolan {
namespace {

// How often those that wait for their budget are looked at.
constexpr auto kRetryInterval = std::chrono::milliseconds(500);

}  // namespace

CorrectionDispatcher::CorrectionDispatcher(const CorrectionOptions& options, SnapshotHub* hub)
    : options_(options), hub_(hub) {}

CorrectionDispatcher::~CorrectionDispatcher() { Shutdown(); }

void CorrectionDispatcher::Start() {
  subscription_ = hub_->Subscribe([signal = signal_] {
    const std::lock_guard lock(signal->mutex);
    signal->raised = true;
    signal->wake.notify_one();
  });
  thread_ = std::thread([this] { Run(); });
}

void CorrectionDispatcher::Wake() {
  const std::lock_guard lock(signal_->mutex);
  signal_->raised = true;
  signal_->wake.notify_one();
}

void CorrectionDispatcher::Connect(const Key& session, uint64_t received_map_version,
                                   std::weak_ptr<CorrectionSink> sink) {
  {
    const std::lock_guard lock(mutex_);
    Session& entry = sessions_[session];
    if (!entry.planner) entry.planner = std::make_unique<CorrectionPlanner>(options_);
    entry.sink = std::move(sink);
    entry.resumes = true;
    entry.received_map_version = received_map_version;
    entry.flushes.clear();
  }
  Wake();
}

void CorrectionDispatcher::Flush(const Key& session, std::function<void(uint64_t)> done) {
  {
    const std::lock_guard lock(mutex_);
    sessions_[session].flushes.push_back(std::move(done));
  }
  Wake();
}

void CorrectionDispatcher::Shutdown() {
  if (!thread_.joinable()) return;
  hub_->Unsubscribe(subscription_);
  {
    const std::lock_guard lock(signal_->mutex);
    signal_->stop = true;
    signal_->wake.notify_one();
  }
  thread_.join();
}

void CorrectionDispatcher::Run() {
  bool some_wait = false;
  while (true) {
    {
      std::unique_lock lock(signal_->mutex);
      const auto is_raised = [&] { return signal_->raised || signal_->stop; };
      if (some_wait) {
        signal_->wake.wait_for(lock, kRetryInterval, is_raised);
      } else {
        signal_->wake.wait(lock, is_raised);
      }
      if (signal_->stop) return;
      signal_->raised = false;
    }
    some_wait = ServeAll(*hub_->Get());
  }
}

bool CorrectionDispatcher::ServeAll(const MapSnapshot& snapshot) {
  StatesBySession states;
  for (const auto& state : snapshot.submaps) {
    // A quarantined submap lies in no agent's world.
    if (!state->refined->quarantine_reason.empty()) continue;
    const SubmapKey& key = state->refined->raw->key;
    states[{key.agent, key.session}].push_back(state);
  }
  bool some_wait = false;
  std::vector<Delivery> deliveries;
  {
    const std::lock_guard lock(mutex_);
    for (auto& [key, session] : sessions_) {
      deliveries.push_back(Plan(&session, states[key], snapshot));
      some_wait |= session.planner && session.planner->has_deferred();
    }
  }
  for (const Delivery& delivery : deliveries) {
    if (delivery.correction) delivery.sink->Send(*delivery.correction);
    for (const auto& done : delivery.flushes) done(snapshot.version);
  }
  return some_wait;
}

CorrectionDispatcher::Delivery CorrectionDispatcher::Plan(Session* session,
                                                          const CorrectionPlanner::States& states,
                                                          const MapSnapshot& snapshot) {
  Delivery delivery;
  delivery.sink = session->sink.lock();
  if (!delivery.sink || !delivery.sink->IsReady()) return delivery;
  if (session->resumes) {
    session->planner->Resume(session->received_map_version, states, snapshot.version);
    session->resumes = false;
  }
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  delivery.correction = session->planner->Next(states, snapshot, now, !session->flushes.empty());
  delivery.flushes = std::exchange(session->flushes, {});
  return delivery;
}

}  // namespace portolan
