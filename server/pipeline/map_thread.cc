#include "server/pipeline/map_thread.h"

#include <algorithm>
#include <utility>

#include "common/base/logging.h"

namespace portolan {

namespace {

// Submaps that are prepared before their integration; memory allows no more, for a prepared one is
// twice as large.
constexpr size_t kPreparedAhead = 8;

}  // namespace

Status MapThreadOptions::Validate() const {
  if (max_queue < 1) return absl::InvalidArgumentError("max_queue must be positive");
  if (save_interval < Duration::zero()) {
    return absl::InvalidArgumentError("save_interval must not be negative");
  }
  if (background_patience < Duration::zero()) {
    return absl::InvalidArgumentError("background_patience must not be negative");
  }
  if (settling_patience < Duration::zero()) {
    return absl::InvalidArgumentError("settling_patience must not be negative");
  }
  return absl::OkStatus();
}

MapThread::MapThread(const MapThreadOptions& options, std::unique_ptr<MapEngine> engine,
                     MapStore* store, SnapshotHub* hub)
    : options_(options),
      engine_(std::move(engine)),
      store_(store),
      hub_(hub),
      last_save_(std::chrono::steady_clock::now()),
      last_input_(last_save_) {}

MapThread::~MapThread() { Shutdown(); }

void MapThread::Start(std::vector<SubmapInput> backlog) {
  published_ = saved_ = engine_->snapshot();
  hub_->Publish(published_);
  pushed_count_ = backlog.size();
  for (SubmapInput& input : backlog) {
    queue_.push_back(std::make_shared<Entry>(Entry{std::move(input)}));
  }
  thread_ = std::thread([this] { Run(); });
  preparing_thread_ = std::thread([this] { RunPreparations(); });
}

void MapThread::Push(std::vector<SubmapInput> submaps) {
  std::unique_lock lock(mutex_);
  for (SubmapInput& submap : submaps) {
    has_room_.wait(
        lock, [&] { return stop_ || queue_.size() < static_cast<size_t>(options_.max_queue); });
    if (stop_) return;
    queue_.push_back(std::make_shared<Entry>(Entry{std::move(submap)}));
    ++pushed_count_;
    has_entry_.notify_one();
    if (queue_.size() > kPreparedAhead) wake_.notify_one();
  }
}

void MapThread::SetSurvey(std::shared_ptr<const Survey> survey) {
  const std::lock_guard lock(mutex_);
  if (stop_) return;
  if (!survey_) ++pushed_count_;
  survey_ = std::move(survey);
  if (!options_.lockstep) interrupt_ = true;
  wake_.notify_one();
}

void MapThread::WhenSettled(std::function<void(uint64_t)> done) {
  const std::lock_guard lock(mutex_);
  if (stop_) return;
  waiters_.push_back({pushed_count_, std::move(done)});
  wake_.notify_one();
}

void MapThread::Shutdown() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
    interrupt_ = true;
    wake_.notify_one();
    has_room_.notify_all();
    has_entry_.notify_all();
  }
  if (thread_.joinable()) thread_.join();
  if (preparing_thread_.joinable()) preparing_thread_.join();
}

void MapThread::Run() {
  std::unique_lock lock(mutex_);
  while (!stop_) {
    if (HasPrepared()) {
      const std::shared_ptr<Entry> entry = queue_.front();
      queue_.pop_front();
      has_room_.notify_one();
      has_entry_.notify_one();
      lock.unlock();
      Integrate(entry->input);
      lock.lock();
      ++integrated_count_;
      continue;
    }
    const auto await_prepared = [&] {
      wake_.wait(lock, [&] {
        return stop_ || HasPrepared() || NextToRefine() != nullptr || queue_.empty();
      });
    };
    // What is done between two submaps must not depend on how long the next one's preparation
    // takes.
    if (options_.lockstep && !queue_.empty()) {
      await_prepared();
      continue;
    }
    if (survey_) {
      const std::shared_ptr<const Survey> survey = std::exchange(survey_, nullptr);
      lock.unlock();
      engine_->SetSurvey(survey);
      lock.lock();
      ++integrated_count_;
      last_input_ = std::chrono::steady_clock::now();
      continue;
    }
    if (const std::shared_ptr<Entry> entry = NextToRefine(); entry != nullptr) {
      entry->is_taken = true;
      const SubmapInput input = entry->input;
      lock.unlock();
      std::shared_ptr<const RefinedSubmap> refined = engine_->Refine(input);
      lock.lock();
      entry->input.refined = std::move(refined);
      continue;
    }
    // Background work would take the preparing thread's core.
    if (IsBehind()) {
      await_prepared();
      continue;
    }
    interrupt_ = false;
    lock.unlock();
    if (engine_->HasBackgroundWork()) {
      engine_->RunBackgroundWork(interrupt_);
      Publish();
      lock.lock();
      continue;
    }
    lock.lock();
    if (!queue_.empty()) {
      await_prepared();
      continue;
    }
    const bool is_settled = !engine_->HasUnsettled();
    const bool must_settle = !is_settled && MaySettle();
    lock.unlock();
    if (must_settle) {
      engine_->Settle(interrupt_);
      Publish();
      lock.lock();
      continue;
    }
    Save();
    if (is_settled) NotifySettled();
    lock.lock();
    AwaitInput(is_settled, &lock);
  }
  lock.unlock();
  Publish();
  Save();
}

bool MapThread::MaySettle() const {
  return !waiters_.empty() || (!options_.lockstep && std::chrono::steady_clock::now() >=
                                                         last_input_ + options_.settling_patience);
}

void MapThread::AwaitInput(bool is_settled, std::unique_lock<std::mutex>* lock) {
  const auto has_input = [this] {
    return stop_ || HasPrepared() || NextToRefine() != nullptr || survey_ != nullptr ||
           !waiters_.empty();
  };
  if (is_settled || options_.lockstep) {
    wake_.wait(*lock, has_input);
  } else {
    wake_.wait_until(*lock, last_input_ + options_.settling_patience, has_input);
  }
}

std::shared_ptr<MapThread::Entry> MapThread::NextToPrepare() const {
  const size_t end = std::min(queue_.size(), kPreparedAhead);
  for (size_t i = 0; i < end; ++i) {
    if (!queue_[i]->is_prepared) return queue_[i];
  }
  return nullptr;
}

bool MapThread::IsBehind() const { return !options_.lockstep && queue_.size() > kPreparedAhead; }

std::shared_ptr<MapThread::Entry> MapThread::NextToRefine() const {
  if (!IsBehind()) return nullptr;
  for (size_t i = kPreparedAhead - 1; i > 0; --i) {
    if (!queue_[i]->is_taken && queue_[i]->input.refined == nullptr) return queue_[i];
  }
  return nullptr;
}

void MapThread::AwaitWork(std::unique_lock<std::mutex>* lock) {
  if (!HasPrepared() || options_.lockstep || interrupt_) {
    has_entry_.wait(*lock);
  } else if (MustInterrupt(std::chrono::steady_clock::now())) {
    interrupt_ = true;
  } else {
    has_entry_.wait_until(*lock, queue_.front()->prepared_at + options_.background_patience);
  }
}

bool MapThread::MustInterrupt(std::chrono::steady_clock::time_point now) const {
  return HasPrepared() && !options_.lockstep &&
         (IsBehind() || now >= queue_.front()->prepared_at + options_.background_patience);
}

void MapThread::RunPreparations() {
  std::unique_lock lock(mutex_);
  while (!stop_) {
    const std::shared_ptr<Entry> entry = NextToPrepare();
    if (entry == nullptr) {
      AwaitWork(&lock);
      continue;
    }
    entry->is_taken = true;
    const SubmapInput input = entry->input;
    lock.unlock();
    std::shared_ptr<const PreparedSubmap> prepared = engine_->Prepare(input);
    lock.lock();
    entry->input.prepared = std::move(prepared);
    entry->is_prepared = true;
    entry->prepared_at = std::chrono::steady_clock::now();
    if (MustInterrupt(entry->prepared_at)) interrupt_ = true;
    wake_.notify_one();
  }
}

void MapThread::Integrate(const SubmapInput& input) {
  engine_->IntegrateSubmap(input);
  last_input_ = std::chrono::steady_clock::now();
  if (options_.lockstep) FinishBackgroundWork();
  Publish();
  const auto now = std::chrono::steady_clock::now();
  if (options_.lockstep || now - last_save_ >= options_.save_interval) Save();
}

void MapThread::FinishBackgroundWork() {
  // Interrupted by Shutdown only, and then the unfinished result is not saved.
  while (engine_->HasBackgroundWork() && !interrupt_) engine_->RunBackgroundWork(interrupt_);
}

void MapThread::Publish() {
  const StageTimes times = engine_->stage_times();
  {
    const std::lock_guard lock(mutex_);
    stage_times_ = times;
  }
  std::shared_ptr<const MapSnapshot> snapshot = engine_->snapshot();
  if (snapshot == published_) return;
  published_ = std::move(snapshot);
  hub_->Publish(published_);
}

void MapThread::Save() {
  if (published_ == saved_) return;
  // In lockstep a half-done step is repeated after the restart instead.
  if (options_.lockstep && interrupt_ && engine_->HasBackgroundWork()) return;
  const Status status = store_->SaveSnapshot(*published_);
  last_save_ = std::chrono::steady_clock::now();
  saved_ = published_;
  if (status.ok()) return;
  LogError("the map was not saved: ", status.ToString());
  const std::lock_guard lock(mutex_);
  if (save_status_.ok()) save_status_ = status;
}

void MapThread::NotifySettled() {
  std::vector<Waiter> settled;
  {
    const std::lock_guard lock(mutex_);
    for (Waiter& waiter : std::exchange(waiters_, {})) {
      (waiter.pushed <= integrated_count_ ? settled : waiters_).push_back(std::move(waiter));
    }
  }
  for (const Waiter& waiter : settled) waiter.done(published_->version);
}

StageTimes MapThread::stage_times() const {
  const std::lock_guard lock(mutex_);
  return stage_times_;
}

int MapThread::queue_size() const {
  const std::lock_guard lock(mutex_);
  return static_cast<int>(pushed_count_ - integrated_count_);
}

Status MapThread::save_status() const {
  const std::lock_guard lock(mutex_);
  return save_status_;
}

}  // namespace portolan
