#include "server/map_builder.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <map>
#include <mutex>
#include <unordered_map>
#include <utility>
#include <vector>

namespace portolan {
namespace {

// Adds the time until its destruction to a stage.
class StageTimer {
 public:
  explicit StageTimer(StageTime* stage)
      : stage_(*stage), start_(std::chrono::steady_clock::now()) {}
  ~StageTimer() {
    const std::chrono::duration<double, std::milli> elapsed =
        std::chrono::steady_clock::now() - start_;
    ++stage_.count;
    stage_.last_ms = elapsed.count();
    stage_.total_ms += elapsed.count();
    stage_.max_ms = std::max(stage_.max_ms, elapsed.count());
  }
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;

 private:
  StageTime& stage_;
  std::chrono::steady_clock::time_point start_;
};

}  // namespace

Status MapBuilderOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(refiner.Validate());
  PORTOLAN_RETURN_IF_ERROR(place_index.Validate());
  PORTOLAN_RETURN_IF_ERROR(verifier.Validate());
  PORTOLAN_RETURN_IF_ERROR(aligner.Validate());
  PORTOLAN_RETURN_IF_ERROR(fuser.Validate());
  if (max_candidates < 0 || enough_closures < 1 || min_sequence_distance < 1 || num_threads < 1) {
    return absl::InvalidArgumentError("map builder: limits out of range");
  }
  return absl::OkStatus();
}

class MapBuilder::Impl {
 public:
  Impl(const MapBuilderOptions& options, SubmapRefiner refiner, std::unique_ptr<PlaceIndex> places,
       Verifier verifier)
      : options_(options),
        refiner_(std::move(refiner)),
        places_(std::move(places)),
        verifier_(std::move(verifier)),
        aligner_(options.aligner),
        fuser_(options.fuser),
        snapshot_(std::make_shared<MapSnapshot>()) {}

  void Restore(std::shared_ptr<const MapSnapshot> snapshot) {
    RestoreMap(*snapshot, &aligner_);
    aligner_.TakeTouched();
    for (const auto& state : snapshot->submaps) {
      if (state->refined->quarantine_reason.empty()) {
        AddPlace(*state->refined);
      }
    }
    snapshot_ = std::move(snapshot);
  }

  void SetSurvey(std::shared_ptr<const Survey> survey) { aligner_.SetSurvey(std::move(survey)); }

  bool Contains(SubmapId id) const { return aligner_.model().Contains(id); }

  std::shared_ptr<const RefinedSubmap> Refine(const SubmapInput& input) const {
    StageTime time;
    std::shared_ptr<const RefinedSubmap> refined;
    {
      const StageTimer timer(&time);
      refined = refiner_.Refine(input.id, input.submap, input.camera);
    }
    const std::lock_guard lock(refine_mutex_);
    refine_time_.last_ms = time.last_ms;
    refine_time_.total_ms += time.total_ms;
    refine_time_.max_ms = std::max(refine_time_.max_ms, time.max_ms);
    ++refine_time_.count;
    return refined;
  }

  void Link(std::shared_ptr<const RefinedSubmap> refined) {
    const StageTimer timer(&times_.link);
    aligner_.AddSubmap(std::move(refined));
  }

  std::vector<PlaceCandidate> Recognise(const RefinedSubmap& refined) {
    const StageTimer timer(&times_.recognise);
    if (!refined.quarantine_reason.empty()) return {};
    const Place here = PlaceOf(*refined.raw);
    const auto admissible = [&](SubmapId id) { return IsCandidate(here, place_of_.at(id)); };
    std::vector<PlaceCandidate> candidates =
        places_->Query(*refined.raw, options_.max_candidates, admissible);
    AddPlace(refined);
    return candidates;
  }

  std::vector<Closure> Verify(const RefinedSubmap& refined,
                              const std::vector<PlaceCandidate>& candidates) {
    const StageTimer timer(&times_.verify);
    std::vector<Closure> closures;
    const bool is_large = aligner_.model().submaps().size() >
                          static_cast<size_t>(options_.aligner.full_component_submaps);
    for (const PlaceCandidate& candidate : candidates) {
      if (is_large && closures.size() >= static_cast<size_t>(options_.enough_closures)) break;
      std::optional<Closure> closure =
          verifier_.Verify(*aligner_.model().submap(candidate.submap).refined, refined);
      if (closure) closures.push_back(*std::move(closure));
    }
    return closures;
  }

  void Align(SubmapId id, const std::vector<Closure>& closures) {
    const StageTimer timer(&times_.align);
    aligner_.AddClosures(closures);
    aligner_.AdjustAround(id);
  }

  void Fuse() {
    const StageTimer timer(&times_.fuse);
    snapshot_ = fuser_.Fuse(*snapshot_, &aligner_);
  }

  bool HasBackgroundWork() const { return aligner_.HasBackgroundWork(); }

  void Polish(const std::atomic<bool>& interrupt) {
    const StageTimer timer(&times_.background);
    aligner_.AdjustStaleComponent(interrupt);
  }

  const std::shared_ptr<const MapSnapshot>& snapshot() const { return snapshot_; }
  StageTimes times() const {
    StageTimes times = times_;
    const std::lock_guard lock(refine_mutex_);
    times.refine = refine_time_;
    return times;
  }

 private:
  // Where a submap stands in its agent's way.
  struct Place {
    int session = 0;
    int64_t sequence_number = 0;
  };

  Place PlaceOf(const Submap& raw) {
    const auto session =
        sessions_.try_emplace({raw.key.agent, raw.key.session}, static_cast<int>(sessions_.size()));
    return {session.first->second, raw.key.sequence_number};
  }

  void AddPlace(const RefinedSubmap& refined) {
    place_of_[refined.id] = PlaceOf(*refined.raw);
    places_->Add(refined.id, *refined.raw);
  }

  bool IsCandidate(const Place& here, const Place& there) const {
    return here.session != there.session ||
           std::abs(here.sequence_number - there.sequence_number) >= options_.min_sequence_distance;
  }

  const MapBuilderOptions options_;
  const SubmapRefiner refiner_;
  const std::unique_ptr<PlaceIndex> places_;
  const Verifier verifier_;
  MapAligner aligner_;
  const MapFuser fuser_;
  std::shared_ptr<const MapSnapshot> snapshot_;
  std::map<std::pair<AgentId, SessionId>, int> sessions_;
  // Of every submap in the place index.
  std::unordered_map<SubmapId, Place> place_of_;
  StageTimes times_;
  mutable std::mutex refine_mutex_;
  mutable StageTime refine_time_;  // guarded by refine_mutex_
};

StatusOr<std::unique_ptr<MapBuilder>> MapBuilder::Create(const MapBuilderOptions& options) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  MapBuilderOptions own = options;
  own.refiner.bundle.num_threads = options.num_threads;
  own.aligner.adjuster.bundle.num_threads = options.num_threads;
  PORTOLAN_ASSIGN_OR_RETURN(SubmapRefiner refiner, SubmapRefiner::Create(own.refiner));
  PORTOLAN_ASSIGN_OR_RETURN(std::unique_ptr<PlaceIndex> places,
                            PlaceIndex::Create(own.place_index));
  PORTOLAN_ASSIGN_OR_RETURN(Verifier verifier, Verifier::Create(own.verifier));
  return std::unique_ptr<MapBuilder>(new MapBuilder(
      std::make_unique<Impl>(own, std::move(refiner), std::move(places), std::move(verifier))));
}

MapBuilder::MapBuilder(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
MapBuilder::~MapBuilder() = default;

void MapBuilder::Restore(std::shared_ptr<const MapSnapshot> snapshot) {
  impl_->Restore(std::move(snapshot));
}

void MapBuilder::SetSurvey(std::shared_ptr<const Survey> survey) {
  impl_->SetSurvey(std::move(survey));
}

std::shared_ptr<const RefinedSubmap> MapBuilder::Refine(const SubmapInput& input) const {
  return impl_->Refine(input);
}

void MapBuilder::IntegrateSubmap(const SubmapInput& input) {
  if (impl_->Contains(input.id)) return;
  const std::shared_ptr<const RefinedSubmap> refined =
      input.refined != nullptr ? input.refined : impl_->Refine(input);
  impl_->Link(refined);
  const std::vector<PlaceCandidate> candidates = impl_->Recognise(*refined);
  const std::vector<Closure> closures = impl_->Verify(*refined, candidates);
  impl_->Align(input.id, closures);
  impl_->Fuse();
}

bool MapBuilder::HasBackgroundWork() const { return impl_->HasBackgroundWork(); }

void MapBuilder::RunBackgroundWork(const std::atomic<bool>& interrupt) {
  if (!impl_->HasBackgroundWork()) return;
  impl_->Polish(interrupt);
  impl_->Fuse();
}

std::shared_ptr<const MapSnapshot> MapBuilder::snapshot() const { return impl_->snapshot(); }

StageTimes MapBuilder::stage_times() const { return impl_->times(); }

}  // namespace portolan
