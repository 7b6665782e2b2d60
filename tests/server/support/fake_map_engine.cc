#include "tests/server/support/fake_map_engine.h"

#include <algorithm>
#include <random>
#include <thread>
#include <utility>

#include "common/base/concat.h"

namespace portolan::testing {

void EngineProbe::Hold() {
  const std::lock_guard lock(mutex_);
  hold_ = true;
}

void EngineProbe::Release() {
  const std::lock_guard lock(mutex_);
  hold_ = false;
  changed_.notify_all();
}

void EngineProbe::SetBackgroundEndless(bool endless) {
  const std::lock_guard lock(mutex_);
  background_endless_ = endless;
}

bool EngineProbe::background_endless() const {
  const std::lock_guard lock(mutex_);
  return background_endless_;
}

std::vector<std::string> EngineProbe::events() const {
  const std::lock_guard lock(mutex_);
  return events_;
}

void EngineProbe::WaitForEvent(const std::string& event) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock,
                [&] { return std::find(events_.begin(), events_.end(), event) != events_.end(); });
}

void EngineProbe::WaitForPreparations(int count) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return preparations_ >= count; });
}

void EngineProbe::CountPreparation() {
  const std::lock_guard lock(mutex_);
  ++preparations_;
  changed_.notify_all();
}

void EngineProbe::NoteUnsettled() {
  const std::lock_guard lock(mutex_);
  is_unsettled_known_ = true;
  changed_.notify_all();
}

void EngineProbe::WaitUntilUnsettledIsKnown() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return is_unsettled_known_; });
}

void EngineProbe::Add(const std::string& event) {
  const std::lock_guard lock(mutex_);
  events_.push_back(event);
  changed_.notify_all();
}

void EngineProbe::WaitWhileHeld() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return !hold_; });
}

std::shared_ptr<const SubmapState> MakeFakeState(const SubmapInput& input, int landmarks,
                                                 uint64_t version) {
  auto refined = std::make_shared<RefinedSubmap>();
  refined->id = input.id;
  refined->raw = input.submap;
  refined->camera = input.camera;
  auto state = std::make_shared<SubmapState>();
  state->component = ComponentId(1);
  state->moved_at_version = version;
  state->world_from_submap.scale = 2;
  state->world_from_submap.translation = Eigen::Vector3d(10.0 * input.id.value(), 0, 0);
  for (const Keyframe& keyframe : input.submap->keyframes) {
    refined->submap_from_camera.push_back(keyframe.submap_from_camera);
    state->world_from_camera.push_back(state->world_from_submap * keyframe.submap_from_camera);
  }
  std::mt19937 random(static_cast<unsigned>(input.id.value()));
  std::uniform_real_distribution<double> uniform(-5, 5);
  for (int i = 0; i < landmarks; ++i) {
    const LandmarkSight sight{input.id, TrackId(i)};
    const Eigen::Vector3d point(uniform(random), uniform(random), uniform(random));
    refined->landmarks.push_back({sight.track, 2, point, Symmetric3()});
    state->landmarks.push_back(
        {LandmarkIdOf(sight), state->world_from_submap * point, Symmetric3(), 2 + i % 3, {sight}});
  }
  state->refined = std::move(refined);
  return state;
}

FakeMapEngine::FakeMapEngine(const FakeMapEngineOptions& options,
                             std::shared_ptr<EngineProbe> probe)
    : options_(options), probe_(std::move(probe)) {
  auto empty = std::make_shared<MapSnapshot>();
  empty->closures = std::make_shared<const ClosureList>();
  snapshot_ = std::move(empty);
}

void FakeMapEngine::Restore(std::shared_ptr<const MapSnapshot> snapshot) {
  probe_->Add(Concat("restore ", snapshot->submaps.size()));
  snapshot_ = std::move(snapshot);
}

std::shared_ptr<const PreparedSubmap> FakeMapEngine::Prepare(const SubmapInput&) {
  probe_->CountPreparation();
  return nullptr;
}

void FakeMapEngine::IntegrateSubmap(const SubmapInput& input) {
  probe_->WaitWhileHeld();
  auto next = std::make_shared<MapSnapshot>(*snapshot_);
  ++next->version;
  next->submaps.push_back(MakeFakeState(input, options_.landmarks_per_submap, next->version));
  next->components = {{ComponentId(1), false, false}};
  snapshot_ = std::move(next);
  has_background_work_ = options_.has_background_work;
  is_unsettled_ = options_.settles;
  const SubmapKey& key = input.submap->key;
  probe_->Add(Concat("integrate ", key.agent.value(), "/", key.sequence_number));
}

bool FakeMapEngine::AwaitEnd(const std::atomic<bool>& interrupt) const {
  while (probe_->background_endless()) {
    if (interrupt) {
      probe_->Add("interrupted");
      return false;
    }
    std::this_thread::yield();
  }
  return true;
}

bool FakeMapEngine::HasUnsettled() const {
  if (is_unsettled_) probe_->NoteUnsettled();
  return is_unsettled_;
}

void FakeMapEngine::Settle(const std::atomic<bool>& interrupt) {
  probe_->Add("settle");
  if (!AwaitEnd(interrupt)) return;
  is_unsettled_ = false;
}

void FakeMapEngine::RunBackgroundWork(const std::atomic<bool>& interrupt) {
  probe_->Add("background");
  if (!AwaitEnd(interrupt)) return;
  has_background_work_ = false;
  if (options_.background_shift == 0) return;
  auto next = std::make_shared<MapSnapshot>(*snapshot_);
  ++next->version;
  for (auto& state : next->submaps) {
    auto moved = std::make_shared<SubmapState>(*state);
    moved->moved_at_version = next->version;
    moved->world_from_submap.translation.y() += options_.background_shift;
    for (Rigid3& pose : moved->world_from_camera) {
      pose.translation.y() += options_.background_shift;
    }
    state = std::move(moved);
  }
  snapshot_ = std::move(next);
}

}  // namespace portolan::testing
