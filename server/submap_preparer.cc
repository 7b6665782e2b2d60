#include "server/submap_preparer.h"

#include <cstdlib>
#include <optional>

namespace portolan {

StatusOr<std::unique_ptr<SubmapPreparer>> SubmapPreparer::Create(const MapBuilderOptions& options) {
  PORTOLAN_ASSIGN_OR_RETURN(SubmapRefiner refiner, SubmapRefiner::Create(options.refiner));
  PORTOLAN_ASSIGN_OR_RETURN(RedundancyRemover remover,
                            RedundancyRemover::Create(options.redundancy));
  PORTOLAN_ASSIGN_OR_RETURN(std::unique_ptr<PlaceIndex> places,
                            PlaceIndex::Create(options.place_index));
  PORTOLAN_ASSIGN_OR_RETURN(Verifier verifier, Verifier::Create(options.verifier));
  return std::unique_ptr<SubmapPreparer>(new SubmapPreparer(
      options, std::move(refiner), std::move(remover), std::move(places), std::move(verifier)));
}

SubmapPreparer::SubmapPreparer(const MapBuilderOptions& options, SubmapRefiner refiner,
                               RedundancyRemover remover, std::unique_ptr<PlaceIndex> places,
                               Verifier verifier)
    : options_(options),
      refiner_(std::move(refiner)),
      remover_(std::move(remover)),
      places_(std::move(places)),
      verifier_(std::move(verifier)) {}

void SubmapPreparer::Restore(const MapSnapshot& snapshot) {
  for (const auto& state : snapshot.submaps) {
    refined_.emplace(state->refined->id, state->refined);
    if (state->refined->quarantine_reason.empty()) AddPlace(*state->refined);
  }
}

std::shared_ptr<const RefinedSubmap> SubmapPreparer::Refine(const SubmapInput& input) const {
  const StageClock clock;
  std::shared_ptr<const RefinedSubmap> refined =
      remover_.Remove(refiner_.Refine(input.id, input.submap, input.camera));
  AddTime(&StageTimes::refine, clock.ElapsedMs());
  return refined;
}

std::shared_ptr<const PreparedSubmap> SubmapPreparer::Prepare(const SubmapInput& input) {
  auto prepared = std::make_shared<PreparedSubmap>();
  if (const auto known = refined_.find(input.id); known != refined_.end()) {
    prepared->refined = known->second;
    return prepared;
  }
  prepared->refined = input.refined != nullptr ? input.refined : Refine(input);
  const RefinedSubmap& refined = *prepared->refined;
  refined_.emplace(input.id, prepared->refined);
  const StageClock recognising;
  const std::vector<PlaceCandidate> candidates = Recognise(refined);
  AddTime(&StageTimes::recognise, recognising.ElapsedMs());
  const StageClock verifying;
  prepared->closures = Verify(refined, candidates);
  AddTime(&StageTimes::verify, verifying.ElapsedMs());
  return prepared;
}

std::vector<PlaceCandidate> SubmapPreparer::Recognise(const RefinedSubmap& refined) {
  if (!refined.quarantine_reason.empty()) return {};
  const Place here = PlaceOf(*refined.raw);
  const auto admissible = [&](SubmapId id) { return IsCandidate(here, place_of_.at(id)); };
  std::vector<PlaceCandidate> candidates =
      places_->Query(*refined.raw, options_.max_candidates, admissible);
  AddPlace(refined);
  return candidates;
}

std::vector<Closure> SubmapPreparer::Verify(const RefinedSubmap& refined,
                                            const std::vector<PlaceCandidate>& candidates) const {
  std::vector<Closure> closures;
  const bool is_large =
      refined_.size() > static_cast<size_t>(options_.aligner.full_component_submaps);
  const std::optional<SubmapPoints> points = verifier_.PointsOf(refined);
  for (const PlaceCandidate& candidate : candidates) {
    if (is_large && closures.size() >= static_cast<size_t>(options_.enough_closures)) break;
    std::optional<Closure> closure =
        verifier_.Verify(verifier_.PointsOf(*refined_.at(candidate.submap)), points);
    if (closure) closures.push_back(*std::move(closure));
  }
  return closures;
}

SubmapPreparer::Place SubmapPreparer::PlaceOf(const Submap& raw) {
  const auto session =
      sessions_.try_emplace({raw.key.agent, raw.key.session}, static_cast<int>(sessions_.size()));
  return {session.first->second, raw.key.sequence_number};
}

void SubmapPreparer::AddPlace(const RefinedSubmap& refined) {
  place_of_[refined.id] = PlaceOf(*refined.raw);
  places_->Add(refined.id, refined.raw);
}

bool SubmapPreparer::IsCandidate(const Place& here, const Place& there) const {
  return here.session != there.session ||
         std::abs(here.sequence_number - there.sequence_number) >= options_.min_sequence_distance;
}

void SubmapPreparer::AddTime(StageTime StageTimes::* stage, double ms) const {
  const std::lock_guard lock(times_mutex_);
  (times_.*stage).Add(ms);
}

StageTimes SubmapPreparer::times() const {
  const std::lock_guard lock(times_mutex_);
  return times_;
}

}  // namespace portolan
