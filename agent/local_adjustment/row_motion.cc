#include "agent/local_adjustment/row_motion.h"

#include <algorithm>

namespace portolan {
namespace {

constexpr size_t kFrames = 3;
// Over a longer step the motion is not that of the moment.
constexpr double kLongestStepS = 0.15;

}  // namespace

const RowMotion::Seen* RowMotion::Find(const Frame& frame, TrackId track) {
  const auto at =
      std::lower_bound(frame.tracks.begin(), frame.tracks.end(), track,
                       [](const Seen& candidate, TrackId id) { return candidate.track < id; });
  return at == frame.tracks.end() || at->track != track ? nullptr : &*at;
}

Eigen::Vector2f RowMotion::Of(const Eigen::Vector2f& pixel, const Eigen::Vector2f& way,
                              double time_s) const {
  const double share = pixel.y() / height_px_ - 0.5;
  return static_cast<float>(-share / time_s) * way;
}

void RowMotion::Measure(Timestamp time, std::vector<LiveSight>* sights) {
  if (!frames_.empty()) {
    const double step_s = ToSeconds(time - frames_.back().time);
    if (!(step_s > 0 && step_s < kLongestStepS)) frames_.clear();
  }
  Frame now{time, {}};
  for (LiveSight& sight : *sights) {
    const Observation& seen = sight.observation;
    now.tracks.push_back({seen.track, seen.pixel});
    if (frames_.empty()) continue;
    const Seen* before = Find(frames_.back(), seen.track);
    if (before == nullptr) continue;
    sight.row_motion =
        Of(seen.pixel, seen.pixel - before->pixel, ToSeconds(time - frames_.back().time));
  }
  frames_.push_back(std::move(now));
  if (frames_.size() > kFrames) frames_.pop_front();
}

std::optional<Timestamp> RowMotion::middle() const {
  if (frames_.size() < kFrames) return std::nullopt;
  return frames_[1].time;
}

std::vector<RowMotion::OfTrack> RowMotion::MeasureMiddle() const {
  std::vector<OfTrack> result;
  if (frames_.size() < kFrames) return result;
  const double time_s = ToSeconds(frames_[2].time - frames_[0].time);
  for (const Seen& seen : frames_[1].tracks) {
    const Seen *before = Find(frames_[0], seen.track), *after = Find(frames_[2], seen.track);
    if (before == nullptr || after == nullptr) continue;
    result.push_back({seen.track, Of(seen.pixel, after->pixel - before->pixel, time_s)});
  }
  return result;
}

}  // namespace portolan
