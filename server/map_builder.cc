#include "server/map_builder.h"

#include <utility>
#include <vector>

namespace portolan {

Status MapBuilderOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(refiner.Validate());
  PORTOLAN_RETURN_IF_ERROR(redundancy.Validate());
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
  Impl(const MapBuilderOptions& options, std::unique_ptr<SubmapPreparer> preparer)
      : preparer_(std::move(preparer)),
        aligner_(options.aligner),
        fuser_(options.fuser),
        snapshot_(std::make_shared<MapSnapshot>()) {}

  void Restore(std::shared_ptr<const MapSnapshot> snapshot) {
    RestoreMap(*snapshot, &aligner_);
    aligner_.TakeTouched();
    preparer_->Restore(*snapshot);
    snapshot_ = std::move(snapshot);
  }

  void SetSurvey(std::shared_ptr<const Survey> survey) { aligner_.SetSurvey(std::move(survey)); }

  bool Contains(SubmapId id) const { return aligner_.model().Contains(id); }

  std::shared_ptr<const RefinedSubmap> Refine(const SubmapInput& input) const {
    return preparer_->Refine(input);
  }

  std::shared_ptr<const PreparedSubmap> Prepare(const SubmapInput& input) {
    return preparer_->Prepare(input);
  }

  void Link(std::shared_ptr<const RefinedSubmap> refined) {
    const StageTimer timer(&times_.link);
    aligner_.AddSubmap(std::move(refined));
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

  bool HasUnsettled() const { return aligner_.HasUnsettled(); }

  void Settle(const std::atomic<bool>& interrupt) {
    const StageTimer timer(&times_.background);
    aligner_.SettleComponent(interrupt);
  }

  const std::shared_ptr<const MapSnapshot>& snapshot() const { return snapshot_; }
  StageTimes times() const {
    StageTimes times = preparer_->times();
    times.link = times_.link;
    times.align = times_.align;
    times.fuse = times_.fuse;
    times.background = times_.background;
    return times;
  }

 private:
  const std::unique_ptr<SubmapPreparer> preparer_;
  MapAligner aligner_;
  const MapFuser fuser_;
  std::shared_ptr<const MapSnapshot> snapshot_;
  StageTimes times_;
};

StatusOr<std::unique_ptr<MapBuilder>> MapBuilder::Create(const MapBuilderOptions& options) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  MapBuilderOptions own = options;
  own.refiner.bundle.num_threads = options.num_threads;
  own.aligner.adjuster.bundle.num_threads = options.num_threads;
  PORTOLAN_ASSIGN_OR_RETURN(std::unique_ptr<SubmapPreparer> preparer, SubmapPreparer::Create(own));
  return std::unique_ptr<MapBuilder>(
      new MapBuilder(std::make_unique<Impl>(own, std::move(preparer))));
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

std::shared_ptr<const PreparedSubmap> MapBuilder::Prepare(const SubmapInput& input) {
  return impl_->Prepare(input);
}

void MapBuilder::IntegrateSubmap(const SubmapInput& input) {
  if (impl_->Contains(input.id)) return;
  const std::shared_ptr<const PreparedSubmap> prepared =
      input.prepared != nullptr ? input.prepared : impl_->Prepare(input);
  impl_->Link(prepared->refined);
  impl_->Align(input.id, prepared->closures);
  impl_->Fuse();
}

bool MapBuilder::HasBackgroundWork() const { return impl_->HasBackgroundWork(); }

void MapBuilder::RunBackgroundWork(const std::atomic<bool>& interrupt) {
  if (!impl_->HasBackgroundWork()) return;
  impl_->Polish(interrupt);
  impl_->Fuse();
}

bool MapBuilder::HasUnsettled() const { return impl_->HasUnsettled(); }

void MapBuilder::Settle(const std::atomic<bool>& interrupt) {
  if (!impl_->HasUnsettled()) return;
  impl_->Settle(interrupt);
  impl_->Fuse();
}

void MapBuilder::SettleCompletely() {
  const std::atomic<bool> never = false;
  while (HasBackgroundWork() || HasUnsettled()) {
    if (HasBackgroundWork()) {
      RunBackgroundWork(never);
    } else {
      Settle(never);
    }
  }
}

std::shared_ptr<const MapSnapshot> MapBuilder::snapshot() const { return impl_->snapshot(); }

StageTimes MapBuilder::stage_times() const { return impl_->times(); }

}  // namespace portolan
