#include "server/verification/descriptor_matcher.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace portolan {
namespace {

bool NearerThan(const PointMatch& x, const PointMatch& y) {
  return std::tie(x.distance_bits, x.a, x.b) < std::tie(y.distance_bits, y.a, y.b);
}

bool SamePoint(const DescribedKeyframe& keyframe, size_t i, size_t j, double same_point_px) {
  if (keyframe.points[i] == keyframe.points[j]) return true;
  const int half_octave = std::max(keyframe.half_octaves[i], keyframe.half_octaves[j]);
  const double limit = same_point_px * std::exp2(0.5 * std::min(half_octave, 8));
  return (keyframe.pixels[i] - keyframe.pixels[j]).norm() < limit;
}

// Matches one keyframe of a with one of b.
class KeyframeMatcher {
 public:
  KeyframeMatcher(const DescribedKeyframe& a, const DescribedKeyframe& b,
                  const DescriptorMatcherOptions& options)
      : a_(a), b_(b), options_(options) {}

  void Append(DescriptorMatches* matches) {
    const auto limit = static_cast<uint32_t>(options_.max_distance_bits);
    for (size_t i = 0; i < a_.descriptors.size(); ++i) {
      const Descriptor descriptor = a_.descriptors[i];
      const auto [distance, j] = b_.descriptors.Nearest(descriptor);
      if (distance > limit) continue;
      b_.descriptors.Distances(descriptor, &distances_);
      AppendAlternatives(i, &matches->alternatives);
      const double second = SecondNearest(j);
      if (distance < options_.max_ratio * second && IsMutual(i, j)) {
        matches->putative.push_back(Match(i, j, distance));
      }
    }
  }

 private:
  PointMatch Match(size_t i, size_t j, uint32_t distance) const {
    return {a_.points[i], b_.points[j], static_cast<int>(distance), a_.keyframe, b_.keyframe};
  }

  bool IsMutual(size_t i, size_t j) const {
    const auto back = a_.descriptors.Nearest(b_.descriptors[j]);
    return SamePoint(a_, back.index, i, options_.same_point_px);
  }

  // Distance of the nearest feature of b that is not the same point as j.
  uint32_t SecondNearest(size_t j) const {
    uint32_t second = 256;
    for (size_t k = 0; k < distances_.size(); ++k) {
      if (distances_[k] < second && !SamePoint(b_, k, j, options_.same_point_px)) {
        second = distances_[k];
      }
    }
    return second;
  }

  // The few nearest points within the limit.
  void AppendAlternatives(size_t i, std::vector<PointMatch>* alternatives) {
    near_.clear();
    for (size_t k = 0; k < distances_.size(); ++k) {
      if (distances_[k] <= static_cast<uint32_t>(options_.max_distance_bits)) {
        near_.emplace_back(distances_[k], k);
      }
    }
    const size_t sorted = std::min<size_t>(near_.size(), 16 * options_.max_alternatives);
    std::partial_sort(near_.begin(), near_.begin() + sorted, near_.end());
    near_.resize(sorted);
    std::vector<size_t> kept;
    for (const auto& [distance, k] : near_) {
      if (static_cast<int>(kept.size()) == options_.max_alternatives) break;
      const bool known = std::any_of(kept.begin(), kept.end(), [&, k = k](size_t other) {
        return SamePoint(b_, k, other, options_.same_point_px);
      });
      if (known) continue;
      kept.push_back(k);
      alternatives->push_back(Match(i, k, distance));
    }
  }

  const DescribedKeyframe& a_;
  const DescribedKeyframe& b_;
  const DescriptorMatcherOptions& options_;
  std::vector<uint32_t> distances_;
  std::vector<std::pair<uint32_t, size_t>> near_;
};

// The nearest of each pair of points.
std::vector<PointMatch> UniquePairs(std::vector<PointMatch> matches) {
  const auto pair_of = [](const PointMatch& m) { return std::tie(m.a, m.b); };
  std::stable_sort(matches.begin(), matches.end(), NearerThan);
  std::stable_sort(matches.begin(), matches.end(), [&](const PointMatch& x, const PointMatch& y) {
    return pair_of(x) < pair_of(y);
  });
  const auto same = [&](const PointMatch& x, const PointMatch& y) {
    return pair_of(x) == pair_of(y);
  };
  matches.erase(std::unique(matches.begin(), matches.end(), same), matches.end());
  return matches;
}

}  // namespace

std::vector<PointMatch> KeepOneToOne(std::vector<PointMatch> matches, size_t count_a,
                                     size_t count_b) {
  std::stable_sort(matches.begin(), matches.end(), NearerThan);
  std::vector<bool> taken_a(count_a), taken_b(count_b);
  std::vector<PointMatch> kept;
  for (const PointMatch& match : matches) {
    if (taken_a[match.a] || taken_b[match.b]) continue;
    taken_a[match.a] = taken_b[match.b] = true;
    kept.push_back(match);
  }
  return kept;
}

DescriptorMatches MatchDescriptors(const SubmapPoints& a, const SubmapPoints& b,
                                   const DescriptorMatcherOptions& options) {
  DescriptorMatches matches;
  for (const DescribedKeyframe& keyframe_a : a.keyframes) {
    for (const DescribedKeyframe& keyframe_b : b.keyframes) {
      KeyframeMatcher(keyframe_a, keyframe_b, options).Append(&matches);
    }
  }
  matches.putative = KeepOneToOne(std::move(matches.putative), a.points.size(), b.points.size());
  matches.alternatives = UniquePairs(std::move(matches.alternatives));
  return matches;
}

}  // namespace portolan
