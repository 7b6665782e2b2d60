#include "server/corrections/correction_dispatcher.h"

#include <chrono>
#include <utility>

namespace portolan {
namespace {

// How often those that wait for their budget are looked at, and what is offered to an agent: its
// planner goes through all of the map.
constexpr auto kRetryInterval = std::chrono::milliseconds(500);

}  // namespace

CorrectionDispatcher::CorrectionDispatcher(const CorrectionOptions& options,
                                           const OfferOptions& offers, SnapshotHub* hub)
    : options_(options), offer_options_(offers), hub_(hub) {}

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
                                   std::weak_ptr<CorrectionSink> sink,
                                   double offered_bytes_per_second) {
  {
    const std::lock_guard lock(mutex_);
    Session& entry = sessions_[session];
    if (!entry.planner) entry.planner = std::make_unique<CorrectionPlanner>(options_);
    entry.offers =
        offered_bytes_per_second > 0 && offer_options_.bytes_per_second > 0
            ? std::make_unique<OfferPlanner>(offer_options_, offered_bytes_per_second, &depths_)
            : nullptr;
    entry.next_offers = {};
    entry.sink = std::move(sink);
    entry.resumes = true;
    entry.is_dirty = true;
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
    some_wait = ServeAll();
  }
}

std::set<CorrectionDispatcher::Key> CorrectionDispatcher::Follow(
    std::shared_ptr<const MapSnapshot> snapshot) {
  std::set<Key> changed;
  if (followed_ == snapshot) return changed;
  const auto& states = snapshot->submaps;
  const size_t known = followed_ ? followed_->submaps.size() : 0;
  const bool grows =
      states.size() >= known &&
      (known == 0 || states[known - 1]->refined->id == followed_->submaps[known - 1]->refined->id);
  if (!grows) {
    for (const auto& [key, old] : states_) changed.insert(key);
    states_.clear();
    places_.clear();
  }
  for (size_t i = 0; i < states.size(); ++i) {
    if (i < places_.size()) {
      if (states[i] == followed_->submaps[i]) continue;
      const Place& place = places_[i];
      if (place.states == nullptr) continue;
      (*place.states)[place.position] = states[i];
      changed.insert(*place.session);
      continue;
    }
    places_.emplace_back();
    // A quarantined submap lies in no agent's world.
    if (!states[i]->refined->quarantine_reason.empty()) continue;
    const SubmapKey& key = states[i]->refined->raw->key;
    const auto entry = states_.try_emplace({key.agent, key.session}).first;
    places_.back() = {&entry->second, entry->second.size(), &entry->first};
    entry->second.push_back(states[i]);
    changed.insert(entry->first);
  }
  followed_ = std::move(snapshot);
  return changed;
}

bool CorrectionDispatcher::ServeAll() {
  std::shared_ptr<const MapSnapshot> snapshot;
  bool some_wait = false;
  std::vector<Delivery> deliveries;
  {
    const std::lock_guard lock(mutex_);
    // Taken under the lock, so that no flush is answered from a map that is older than its call.
    snapshot = hub_->Get();
    const std::set<Key> changed = Follow(snapshot);
    const Duration now = std::chrono::steady_clock::now().time_since_epoch();
    for (auto& [key, session] : sessions_) {
      session.is_dirty = session.is_dirty || changed.contains(key);
      if (session.sink.expired()) session.offers.reset();
      some_wait |= session.offers != nullptr;
      if (!session.is_dirty && session.flushes.empty() && !session.offers_due(now)) continue;
      deliveries.push_back(Plan(&session, states_[key], *snapshot, now));
      some_wait |= session.planner && session.planner->has_deferred();
    }
  }
  for (const Delivery& delivery : deliveries) {
    if (delivery.correction) delivery.sink->Send(*delivery.correction);
    for (const auto& done : delivery.flushes) done(snapshot->version);
  }
  return some_wait;
}

CorrectionDispatcher::Delivery CorrectionDispatcher::Plan(Session* session,
                                                          const CorrectionPlanner::States& states,
                                                          const MapSnapshot& snapshot,
                                                          Duration now) {
  Delivery delivery;
  delivery.sink = session->sink.lock();
  if (!delivery.sink || !delivery.sink->IsReady()) return delivery;
  if (session->resumes) {
    session->planner->Resume(session->received_map_version, states, snapshot.version);
    session->resumes = false;
  }
  const bool is_ending = !session->flushes.empty();
  delivery.correction = session->planner->Next(states, snapshot, now, is_ending);
  session->is_dirty = session->planner->has_deferred();
  if (session->offers_due(now) && !is_ending) {
    session->next_offers = now + kRetryInterval;
    std::vector<LandmarkOffer> offers =
        session->offers->Next(states, snapshot, delivery.sink->NewestPose(), now);
    if (!offers.empty() && !delivery.correction) {
      delivery.correction.emplace();
      delivery.correction->map_version = snapshot.version;
      // Says nothing of the placements of this version.
      delivery.correction->more = true;
    }
    if (!offers.empty()) delivery.correction->offers = std::move(offers);
  }
  delivery.flushes = std::exchange(session->flushes, {});
  return delivery;
}

}  // namespace portolan
