// What a run of the agent leaves behind: trajectories and figures.
#ifndef PORTOLAN_AGENT_RUN_RECORDER_H_
#define PORTOLAN_AGENT_RUN_RECORDER_H_

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "agent/agent.h"
#include "agent/corrections/pose_corrector.h"
#include "common/base/status.h"
#include "common/trajectory/trajectory.h"

namespace portolan {

// Figures of one run. Byte counts say what they include in UplinkStats.
struct RunSummary {
  std::string agent;
  int64_t frames = 0;          // processed
  int64_t tracked_frames = 0;  // of these, with an estimate
  int64_t dropped_frames = 0;  // came too fast, real time only
  int64_t skipped_frames = 0;  // unreadable or out of order
  int64_t submaps = 0;
  int64_t lost = 0;  // times that tracking failed
  double frame_ms_median = 0;
  double frame_ms_p95 = 0;
  double cpu_ms_per_frame = 0;     // user + system of the whole process, decoding included
  double landmarks_per_frame = 0;  // that the filter was updated with, mean
  double peak_memory_mb = 0;
  double duration_s = 0;  // of the images, at their own times
  uint64_t sent_bytes = 0;
  uint64_t received_bytes = 0;
  uint64_t pending_submaps = 0;  // left in the outbox

  double sent_kb_per_s() const { return duration_s > 0 ? 1e-3 * sent_bytes / duration_s : 0; }
  double received_kb_per_s() const {
    return duration_s > 0 ? 1e-3 * received_bytes / duration_s : 0;
  }
};

std::string ToText(const RunSummary& summary);
std::string ToJson(const RunSummary& summary);

// Thread-compatible.
class RunRecorder {
 public:
  // Books a processed frame. `placed` is the live pose with the newest correction.
  void AddFrame(Timestamp time, const FrameResult& result, const PlacedPose& placed,
                double frame_ms);

  // Poses as known at their instants, all in one frame: that of the last pose. Poses from before
  // the agent's map joined another one, which were in another frame, are left out.
  Trajectory Live() const;
  // The filter's own poses, chained over connected submaps, without any correction: the longest
  // connected piece.
  Trajectory Odometry() const;
  // The corrected frames of the component that holds most of them.
  static Trajectory Corrected(const PoseCorrector& corrector);

  // Fills in what the recorder and the operating system know.
  void Fill(RunSummary* summary) const;

  // live.tum, odometry.tum, corrected.tum and summary.json, in a folder that is made.
  Status WriteAll(const std::filesystem::path& folder, const PoseCorrector& corrector,
                  const RunSummary& summary) const;

 private:
  struct LivePoseRecord {
    Timestamp time{};
    PlacedPose placed;
  };
  struct OdometryPiece {
    Rigid3 piece_from_submap;
    Trajectory poses;

    // Poses of frames of the present submap that have become known better.
    void Restate(const std::vector<FramePose>& frames);
  };

  std::vector<double> frame_ms_;
  std::vector<LivePoseRecord> live_;
  std::vector<OdometryPiece> pieces_;
  int64_t tracked_frames_ = 0;
  int64_t lost_ = 0;
  int64_t landmarks_measured_ = 0;
  std::optional<Timestamp> first_time_;
  Timestamp last_time_{};
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_RUN_RECORDER_H_
