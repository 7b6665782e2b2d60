#include "server/corrections/offer_planner.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "common/wire/correction_wire.h"
#include "common/wire/offer_wire.h"
#include "server/corrections/correction_planner.h"

namespace portolan {
namespace {

constexpr double kBytesOfView = 110;
constexpr double kBytesOfLandmark = 32;
constexpr int kCellsAcross = 6;
// What the agent sees a little later is outside of the image by this share of its width.
constexpr double kMarginOfWidth = 0.15;

Eigen::Vector3d Forward(const Rigid3& world_from_camera) {
  return world_from_camera.rotation * Eigen::Vector3d::UnitZ();
}

bool IsOfSession(const SubmapState& state, const SubmapKey& key) {
  const SubmapKey& other = state.refined->raw->key;
  return other.agent == key.agent && other.session == key.session;
}

// The landmark whose oldest sight this is, if it is the map's.
const FusedLandmark* FindLandmark(const SubmapState& state, TrackId track) {
  const LandmarkId id = LandmarkIdOf({state.refined->id, track});
  const auto at = std::lower_bound(
      state.landmarks.begin(), state.landmarks.end(), id,
      [](const FusedLandmark& landmark, LandmarkId wanted) { return landmark.id < wanted; });
  return at == state.landmarks.end() || at->id != id ? nullptr : &*at;
}

// In the view's camera, lengths in its submap's units.
OfferedLandmark MakeOffered(const FusedLandmark& landmark, const Similarity3& world_from_camera,
                            const Descriptor& descriptor) {
  OfferedLandmark offered;
  offered.point_in_camera = world_from_camera.Inverse() * landmark.point_in_world;
  const Eigen::Vector3d ray = landmark.point_in_world - world_from_camera.translation;
  const double square = ray.squaredNorm();
  const double along = landmark.covariance.SquareOf(ray) / (square * square);
  const double total = landmark.covariance.Matrix().trace() / square;
  offered.depth_sigma = std::sqrt(std::max(along, 1e-12));
  offered.lateral_sigma = std::sqrt(std::max((total - along) / 2, 1e-12));
  offered.descriptor = descriptor;
  return offered;
}

}  // namespace

Status OfferOptions::Validate() const {
  if (!(bytes_per_second >= 0) || !(burst_bytes > 0) || min_landmarks < 1 ||
      max_landmarks < min_landmarks || max_landmarks > static_cast<int>(kMaxLandmarksPerOffer) ||
      !(max_view_angle_rad > 0) || !(max_distance_of_depth > 0) || max_views < 1 ||
      !(max_depth_sigma > 0) || !(moved > 0) || max_told_views < max_views) {
    return absl::InvalidArgumentError("offer options: a limit is out of range");
  }
  return absl::OkStatus();
}

uint64_t OfferPlanner::View::id() const {
  return (static_cast<uint64_t>(state->refined->id.value()) << 8) | static_cast<uint64_t>(keyframe);
}

Similarity3 OfferPlanner::View::world_from_camera() const {
  return Similarity3::FromRigid(state->world_from_camera[keyframe], state->world_from_submap.scale);
}

Rigid3 PredictCamera(const OfferPlanner::States& own, const std::optional<LivePose>& live_pose) {
  const SubmapState& newest = *own.back();
  const uint32_t number = newest.refined->raw->key.sequence_number;
  const Rigid3& last = newest.world_from_camera.back();
  if (!live_pose) return last;
  if (live_pose->sequence_number == number) {
    return newest.world_from_submap * live_pose->submap_from_camera;
  }
  if (live_pose->sequence_number == number + 1 && live_pose->predecessor_from_submap) {
    // A connected submap begins where its predecessor's last keyframe is.
    return Similarity3::FromRigid(last, newest.world_from_submap.scale) *
           live_pose->submap_from_camera;
  }
  return last;
}

double SubmapDepths::Of(const RefinedSubmap& refined) {
  const auto [entry, is_new] = depths_.try_emplace(refined.id, 0.0);
  if (is_new) entry->second = MedianDepth(refined);
  return entry->second;
}

OfferPlanner::OfferPlanner(const OfferOptions& options, double wanted_bytes_per_second,
                           SubmapDepths* depths)
    : options_(options),
      bytes_per_second_(std::min(options.bytes_per_second, wanted_bytes_per_second)),
      depths_(depths),
      budget_bytes_(options.burst_bytes) {}

void OfferPlanner::RefillBudget(Duration now) {
  if (last_refill_) {
    budget_bytes_ = std::min(options_.burst_bytes,
                             budget_bytes_ + bytes_per_second_ * ToSeconds(now - *last_refill_));
  }
  last_refill_ = now;
}

std::vector<LandmarkOffer> OfferPlanner::Next(const States& own, const MapSnapshot& snapshot,
                                              const std::optional<LivePose>& live_pose,
                                              Duration now) {
  RefillBudget(now);
  std::vector<LandmarkOffer> offers;
  if (bytes_per_second_ <= 0 || budget_bytes_ <= 0 || own.empty() ||
      own.back()->world_from_camera.empty()) {
    return offers;
  }
  Agent agent;
  agent.newest = own.back().get();
  agent.world_from_camera = PredictCamera(own, live_pose);
  agent.camera = agent.newest->refined->camera.get();
  for (const auto& state : own) agent.submaps.insert(state->refined->id);

  // First what the agent holds is set right, then more is added where most is missing.
  const std::vector<View> views = FindViews(agent, snapshot);
  for (const View& view : views) {
    const auto told = told_.find(view.id());
    if (told == told_.end() || !HasMoved(view, told->second)) continue;
    if (budget_bytes_ <= 0 || offers.size() + 1 >= kMaxOffersPerCorrection) return offers;
    offers.push_back(Take(view, {}));
  }
  std::vector<Candidate> best;
  const View* best_view = nullptr;
  for (size_t i = 0; i < std::min<size_t>(views.size(), options_.max_views); ++i) {
    std::vector<Candidate> candidates = FindLandmarks(agent, views[i]);
    if (candidates.size() <= best.size()) continue;
    best = std::move(candidates);
    best_view = &views[i];
  }
  if (budget_bytes_ <= 0 || static_cast<int>(best.size()) < options_.min_landmarks) return offers;
  best.resize(std::min<size_t>(best.size(), options_.max_landmarks));
  offers.push_back(Take(*best_view, best));
  return offers;
}

std::vector<OfferPlanner::View> OfferPlanner::FindViews(const Agent& agent,
                                                        const MapSnapshot& snapshot) const {
  std::vector<View> views;
  const Eigen::Vector3d forward = Forward(agent.world_from_camera);
  const double min_cosine = std::cos(options_.max_view_angle_rad);
  for (const auto& state : snapshot.submaps) {
    if (state->component != agent.newest->component || state->landmarks.empty() ||
        IsOfSession(*state, agent.newest->refined->raw->key)) {
      continue;
    }
    const auto& keyframes = state->refined->raw->keyframes;
    const double depth = state->world_from_submap.scale * depths_->Of(*state->refined);
    for (size_t k = 0; k < std::min(keyframes.size(), state->world_from_camera.size()); ++k) {
      const Rigid3& camera = state->world_from_camera[k];
      const double away = (camera.translation - agent.world_from_camera.translation).norm() / depth;
      if (!(away < options_.max_distance_of_depth) || keyframes[k].features.empty()) continue;
      const double cosine = Forward(camera).dot(forward);
      if (cosine < min_cosine) continue;
      views.push_back({state, static_cast<int>(k), depth,
                       away / options_.max_distance_of_depth +
                           std::acos(std::min(1.0, cosine)) / options_.max_view_angle_rad});
    }
  }
  std::sort(views.begin(), views.end(), [](const View& a, const View& b) {
    return std::tuple(a.distance, a.id()) < std::tuple(b.distance, b.id());
  });
  return views;
}

bool OfferPlanner::HasMoved(const View& view, const Told& told) const {
  const Similarity3 now = view.world_from_camera();
  return view.state->component != told.component ||
         (now.translation - told.world_from_camera.translation).norm() >
             options_.moved * view.depth ||
         now.rotation.angularDistance(told.world_from_camera.rotation) > options_.moved ||
         std::abs(std::log(now.scale / told.world_from_camera.scale)) > options_.moved;
}

std::vector<OfferPlanner::Candidate> OfferPlanner::FindLandmarks(const Agent& agent,
                                                                 const View& view) const {
  std::vector<Candidate> candidates;
  const Similarity3 world_from_view = view.world_from_camera();
  const Rigid3 camera_from_world = agent.world_from_camera.Inverse();
  const double width = agent.camera->width_px();
  for (const Feature& feature : view.state->refined->raw->keyframes[view.keyframe].features) {
    if (feature.half_octave != 0 || !feature.track) continue;
    const FusedLandmark* landmark = FindLandmark(*view.state, *feature.track);
    if (landmark == nullptr || told_landmarks_.contains(landmark->id)) continue;
    const bool is_own =
        std::any_of(landmark->sights.begin(), landmark->sights.end(),
                    [&](const auto& sight) { return agent.submaps.contains(sight.submap); });
    if (is_own) continue;
    const auto pixel = agent.camera->Project(camera_from_world * landmark->point_in_world);
    if (!pixel || !agent.camera->IsInImage(*pixel, -kMarginOfWidth * width)) continue;
    Candidate candidate;
    candidate.landmark = landmark;
    candidate.offered = MakeOffered(*landmark, world_from_view, feature.descriptor);
    if (candidate.offered.depth_sigma > options_.max_depth_sigma ||
        !IsSendable(candidate.offered)) {
      continue;
    }
    candidate.cell = {static_cast<int>(std::floor(kCellsAcross * pixel->x() / width)),
                      static_cast<int>(std::floor(kCellsAcross * pixel->y() / width))};
    candidates.push_back(candidate);
  }
  const auto is_better_known = [](const Candidate& a, const Candidate& b) {
    return std::tuple(a.offered.depth_sigma, a.landmark->id) <
           std::tuple(b.offered.depth_sigma, b.landmark->id);
  };
  std::sort(candidates.begin(), candidates.end(), is_better_known);
  std::map<std::pair<int, int>, int> taken;
  for (Candidate& candidate : candidates) candidate.rank = taken[candidate.cell]++;
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.rank < b.rank; });
  return candidates;
}

void OfferPlanner::ForgetOldestView() {
  const auto oldest =
      std::min_element(told_.begin(), told_.end(),
                       [](const auto& a, const auto& b) { return a.second.last < b.second.last; });
  for (const LandmarkId id : oldest->second.landmarks) told_landmarks_.erase(id);
  told_.erase(oldest);
}

LandmarkOffer OfferPlanner::Take(const View& view, const std::vector<Candidate>& candidates) {
  Told& told = told_[view.id()];
  LandmarkOffer offer;
  offer.view = view.id();
  offer.component = told.component = view.state->component;
  offer.world_from_camera = told.world_from_camera = view.world_from_camera();
  offer.first_index = static_cast<uint32_t>(told.landmarks.size());
  for (const Candidate& candidate : candidates) {
    offer.landmarks.push_back(candidate.offered);
    told.landmarks.push_back(candidate.landmark->id);
    told_landmarks_.insert(candidate.landmark->id);
  }
  told.last = ++takes_;
  if (static_cast<int>(told_.size()) > options_.max_told_views) ForgetOldestView();
  budget_bytes_ -= kBytesOfView + kBytesOfLandmark * static_cast<double>(candidates.size());
  return offer;
}

}  // namespace portolan
