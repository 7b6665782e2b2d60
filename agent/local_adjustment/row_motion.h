// A rolling shutter reads an image's rows one after another, so that a moving camera sees each row
// from another place. To first order a pixel is where it is seen less its own motion in the image
// times how much later its row is read. (Hedborg, Forssen, Felsberg, Ringaby, "Rolling shutter
// bundle adjustment", CVPR 2012, have a pose for every row; a track's flow holds the camera's
// turning, its way and the point's depth at once, and the pose remains one.)
#ifndef PORTOLAN_AGENT_LOCAL_ADJUSTMENT_ROW_MOTION_H_
#define PORTOLAN_AGENT_LOCAL_ADJUSTMENT_ROW_MOTION_H_

#include <deque>
#include <optional>
#include <vector>

#include "agent/local_adjustment/local_adjustment.h"

namespace portolan {

// Measures LiveSight::row_motion: minus the motion of the track in the image [px/s] times the share
// of the image's height that it is under the middle row, to which the image's time belongs.
// Thread-compatible.
class RowMotion {
 public:
  struct OfTrack {
    TrackId track;
    Eigen::Vector2f row_motion;
  };

  explicit RowMotion(int height_px) : height_px_(height_px) {}

  // From the frame before to this one; zero for tracks that it did not see, or too long ago. Frames
  // in order of time; sights by ascending track id.
  void Measure(Timestamp time, std::vector<LiveSight>* sights);

  // The frame before the one measured last; none if there was a gap next to it.
  std::optional<Timestamp> middle() const;
  // From the frame before that one to the one after it, ascending: half a step less behind, so good
  // enough to find the readout from.
  std::vector<OfTrack> MeasureMiddle() const;

 private:
  struct Seen {
    TrackId track;
    Eigen::Vector2f pixel;
  };
  struct Frame {
    Timestamp time{};
    std::vector<Seen> tracks;
  };

  static const Seen* Find(const Frame& frame, TrackId track);
  Eigen::Vector2f Of(const Eigen::Vector2f& pixel, const Eigen::Vector2f& way, double time_s) const;

  const int height_px_;
  std::deque<Frame> frames_;  // oldest first
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_LOCAL_ADJUSTMENT_ROW_MOTION_H_
