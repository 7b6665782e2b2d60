#include "server/redundancy/redundancy_remover.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

// Leverages change while landmarks go: they are found anew after this share of those that are left.
constexpr double kRoundShare = 0.34;

// In every keyframe most of what is seen of landmarks does.
bool Agrees(const RedundancyOptions& options, const RefinedSubmap& submap) {
  const auto agreeing = AgreeingObservations(submap, options.agreeing_chi2);
  for (size_t k = 0; k < agreeing.size(); ++k) {
    const std::vector<Observation>& observations = submap.raw->keyframes[k].observations;
    const auto of_landmarks = std::count_if(
        observations.begin(), observations.end(),
        [&](const Observation& one) { return FindLandmark(submap, one.track) != nullptr; });
    const auto count = std::count(agreeing[k].begin(), agreeing[k].end(), true);
    if (static_cast<double>(count) <
        options.min_agreeing_share * static_cast<double>(of_landmarks)) {
      return false;
    }
  }
  return true;
}

class Selection {
 public:
  Selection(const RedundancyOptions& options, const RefinedSubmap& submap)
      : options_(options),
        submap_(submap),
        held_keyframes_(HeldKeyframes()),
        information_(submap, held_keyframes_, options.agreeing_chi2),
        choice_(SubmapChoice::Everything(submap)) {
    for (const Keyframe& keyframe : submap.raw->keyframes) {
      for (const Feature& feature : keyframe.features) {
        if (feature.track) described_.insert(*feature.track);
      }
    }
  }

  SubmapChoice Run() {
    if (!information_.is_determined()) return choice_;
    if (options_.min_keyframe_information < 1) RemoveKeyframes();
    if (options_.min_landmark_information < 1) RemoveLandmarks();
    return choice_;
  }

 private:
  using Track = SubmapInformation::Track;
  using View = SubmapInformation::View;
  static constexpr int kMinViews = SubmapInformation::kMinViews;

  // Neighbours share the first and the last, closures come from the described ones.
  std::vector<int> HeldKeyframes() const {
    std::vector<int> held;
    const int count = static_cast<int>(submap_.raw->keyframes.size());
    for (int k = 0; k < count; ++k) {
      if (k == 0 || k + 1 == count || !submap_.raw->keyframes[k].features.empty()) {
        held.push_back(k);
      }
    }
    return held;
  }

  bool KeepsEnough(const SubmapChoice& choice, double min_share) const {
    const std::optional<double> share = information_.Share(choice);
    return share && *share >= min_share;
  }

  // The one whose landmarks' positions lose least goes first.
  void RemoveKeyframes() {
    std::vector<SubmapChoice> steps = {choice_};
    std::set<int> candidates;
    for (int k = 0; k < static_cast<int>(choice_.keyframes.size()); ++k) {
      if (std::find(held_keyframes_.begin(), held_keyframes_.end(), k) == held_keyframes_.end()) {
        candidates.insert(k);
      }
    }
    while (!candidates.empty()) {
      const std::vector<double> losses = KeyframeLosses();
      const int least = *std::min_element(candidates.begin(), candidates.end(),
                                          [&](int a, int b) { return losses[a] < losses[b]; });
      candidates.erase(least);
      if (GapWithout(least) > options_.max_keyframe_gap) continue;
      SubmapChoice next = choice_;
      next.keyframes[least] = false;
      DropUnseen(&next);
      if (LeastTracks(next) < options_.min_tracks_of_keyframe) continue;
      choice_ = std::move(next);
      steps.push_back(choice_);
    }
    // The last step that keeps enough, by bisection: the first one does, which is everything.
    size_t enough = 0, too_far = steps.size();
    if (KeepsEnough(steps.back(), options_.min_keyframe_information)) enough = steps.size() - 1;
    while (too_far - enough > 1) {
      const size_t middle = (enough + too_far) / 2;
      (KeepsEnough(steps[middle], options_.min_keyframe_information) ? enough : too_far) = middle;
    }
    choice_ = steps[enough];
  }

  // Length of the run of removed keyframes that k would be part of.
  int GapWithout(int k) const {
    int first = k, last = k;
    while (!choice_.keyframes[first - 1]) --first;
    while (!choice_.keyframes[last + 1]) ++last;
    return last - first + 1;
  }

  // A landmark that too few keyframes see is none.
  void DropUnseen(SubmapChoice* choice) const {
    for (size_t i = 0; i < choice->landmarks.size(); ++i) {
      const Track& track = information_.tracks()[i];
      if (SubmapInformation::ViewCount(track, choice->keyframes) < kMinViews) {
        choice->landmarks[i] = false;
      }
    }
  }

  // Landmarks of the chosen keyframe that sees fewest.
  int LeastTracks(const SubmapChoice& choice) const {
    std::vector<int> counts(choice.keyframes.size(), 0);
    for (size_t i = 0; i < choice.landmarks.size(); ++i) {
      if (!choice.landmarks[i]) continue;
      for (const View& view : information_.tracks()[i].views) ++counts[view.keyframe];
    }
    int least = std::numeric_limits<int>::max();
    for (size_t k = 0; k < counts.size(); ++k) {
      if (choice.keyframes[k]) least = std::min(least, counts[k]);
    }
    return least;
  }

  // By keyframe: how much, on average over its landmarks, the information on their positions drops
  // without it (1: all).
  std::vector<double> KeyframeLosses() const {
    std::vector<double> sums(choice_.keyframes.size(), 0);
    std::vector<int> counts(choice_.keyframes.size(), 0);
    for (size_t i = 0; i < choice_.landmarks.size(); ++i) {
      const Track& track = information_.tracks()[i];
      if (!choice_.landmarks[i]) continue;
      const Eigen::Matrix3d whole = information_.PointInformation(track, choice_.keyframes);
      const double determinant = whole.determinant();
      const bool is_short = SubmapInformation::ViewCount(track, choice_.keyframes) <= kMinViews;
      for (const View& view : track.views) {
        if (!choice_.keyframes[view.keyframe]) continue;
        const Eigen::Matrix3d left = whole - view.d_point.transpose() * view.d_point;
        const double share = is_short ? 0 : std::max(left.determinant() / determinant, 0.0);
        sums[view.keyframe] += 1 - std::cbrt(share);
        ++counts[view.keyframe];
      }
    }
    for (size_t k = 0; k < sums.size(); ++k) sums[k] /= std::max(counts[k], 1);
    return sums;
  }

  // Those with the least leverage first, in rounds; the last one is halved until it fits.
  void RemoveLandmarks() {
    const std::optional<double> before = information_.Share(choice_);
    if (!before) return;
    const double min_share = *before * options_.min_landmark_information;
    while (true) {
      const std::vector<size_t> order = ByWeightedLeverage();
      size_t count = static_cast<size_t>(kRoundShare * static_cast<double>(order.size()));
      const size_t whole_round = count;
      SubmapChoice next = Without(order, count);
      while (count > 0 && !KeepsEnough(next, min_share)) {
        count /= 2;
        next = Without(order, count);
      }
      if (next.landmarks == choice_.landmarks) return;
      choice_ = std::move(next);
      if (count < whole_round) return;
    }
  }

  // Those with descriptors, which closures match, are not among them.
  std::vector<size_t> ByWeightedLeverage() const {
    const Eigen::MatrixXd information = information_.PoseInformation(choice_);
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Identity(information.rows(), information.cols());
    if (!SolvePositiveDefinite(information, covariance)) return {};
    std::vector<std::pair<double, size_t>> leverages;
    for (size_t i = 0; i < choice_.landmarks.size(); ++i) {
      if (!choice_.landmarks[i] || described_.contains(submap_.landmarks[i].track)) continue;
      const double weight = IsShared(i) ? options_.sharing_weight : 1.0;
      leverages.emplace_back(weight * information_.Leverage(i, choice_, covariance), i);
    }
    std::sort(leverages.begin(), leverages.end());
    std::vector<size_t> order;
    for (const auto& [leverage, landmark] : leverages) order.push_back(landmark);
    return order;
  }

  bool IsShared(size_t landmark) const {
    const std::vector<View>& views = information_.tracks()[landmark].views;
    const int last = static_cast<int>(choice_.keyframes.size()) - 1;
    return !views.empty() && (views.front().keyframe == 0 || views.back().keyframe == last);
  }

  // The choice without the first `count` of the order that no keyframe and no cell needs.
  SubmapChoice Without(const std::vector<size_t>& order, size_t count) const {
    SubmapChoice next = choice_;
    std::vector<std::vector<int>> cells(
        choice_.keyframes.size(), std::vector<int>(options_.grid_columns * options_.grid_rows, 0));
    std::vector<int> totals(choice_.keyframes.size(), 0);
    const auto add = [&](size_t landmark, int change) {
      for (const View& view : information_.tracks()[landmark].views) {
        cells[view.keyframe][CellOf(view)] += change;
        totals[view.keyframe] += change;
      }
    };
    for (size_t i = 0; i < next.landmarks.size(); ++i) {
      if (next.landmarks[i]) add(i, 1);
    }
    for (const size_t landmark : order) {
      if (count == 0) break;
      const std::vector<View>& views = information_.tracks()[landmark].views;
      const bool is_needed = std::any_of(views.begin(), views.end(), [&](const View& view) {
        return choice_.keyframes[view.keyframe] &&
               (totals[view.keyframe] <= options_.min_tracks_of_keyframe ||
                cells[view.keyframe][CellOf(view)] <= options_.min_tracks_of_cell);
      });
      if (is_needed) continue;
      next.landmarks[landmark] = false;
      add(landmark, -1);
      --count;
    }
    return next;
  }

  int CellOf(const View& view) const {
    const CameraIntrinsics& image = submap_.camera->intrinsics();
    const auto place = [](double pixel, double size, int cells) {
      return std::clamp(static_cast<int>(pixel / size * cells), 0, cells - 1);
    };
    return place(view.pixel.y(), image.height_px, options_.grid_rows) * options_.grid_columns +
           place(view.pixel.x(), image.width_px, options_.grid_columns);
  }

  const RedundancyOptions& options_;
  const RefinedSubmap& submap_;
  const std::vector<int> held_keyframes_;
  const SubmapInformation information_;
  SubmapChoice choice_;
  std::set<TrackId> described_;
};

}  // namespace

Status RedundancyOptions::Validate() const {
  const auto is_share = [](double share) { return share > 0 && share <= 1; };
  if (!is_share(min_keyframe_information) || !is_share(min_landmark_information)) {
    return absl::InvalidArgumentError("redundancy: the information kept is in (0, 1]");
  }
  if (whole_submaps < 0 || max_keyframe_gap < 1 || min_tracks_of_keyframe < 3 || grid_columns < 1 ||
      grid_rows < 1 || grid_columns > 100 || grid_rows > 100 || min_tracks_of_cell < 0 ||
      !(min_agreeing_share >= 0 && min_agreeing_share <= 1) || !(sharing_weight >= 1) ||
      !(agreeing_chi2 > 0)) {
    return absl::InvalidArgumentError("redundancy: limits out of range");
  }
  return absl::OkStatus();
}

StatusOr<RedundancyRemover> RedundancyRemover::Create(const RedundancyOptions& options) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  return RedundancyRemover(options);
}

SubmapChoice RedundancyRemover::Choose(const RefinedSubmap& submap) const {
  if (!Agrees(options_, submap)) return SubmapChoice::Everything(submap);
  return Selection(options_, submap).Run();
}

std::shared_ptr<const RefinedSubmap> RedundancyRemover::Remove(
    std::shared_ptr<const RefinedSubmap> submap) const {
  const bool keeps_all =
      submap->id.value() <= options_.whole_submaps ||
      (options_.min_keyframe_information >= 1 && options_.min_landmark_information >= 1);
  if (keeps_all || submap->landmarks.empty() || submap->raw->keyframes.size() < 2) return submap;
  const SubmapChoice choice = Choose(*submap);
  if (choice.IsEverything()) return submap;
  auto reduced = std::make_shared<RefinedSubmap>(*submap);
  reduced->landmarks.clear();
  for (size_t i = 0; i < submap->landmarks.size(); ++i) {
    if (choice.landmarks[i]) reduced->landmarks.push_back(submap->landmarks[i]);
  }
  reduced->landmarks.shrink_to_fit();
  const auto agreeing = AgreeingObservations(*reduced, options_.agreeing_chi2);
  for (size_t k = 0; k < choice.keyframes.size(); ++k) {
    if (choice.keyframes[k]) continue;
    reduced->redundant_keyframes.push_back(static_cast<int>(k));
    const std::vector<Observation>& observations = submap->raw->keyframes[k].observations;
    for (size_t i = 0; i < observations.size(); ++i) {
      if (!agreeing[k][i]) continue;
      const RefinedLandmark* landmark = FindLandmark(*reduced, observations[i].track);
      ++reduced->landmarks[landmark - reduced->landmarks.data()].redundant_count;
    }
  }
  return reduced;
}

}  // namespace portolan
