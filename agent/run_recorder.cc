#include "agent/run_recorder.h"

#include <sys/resource.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <map>

#include "absl/strings/str_format.h"
#include "common/trajectory/trajectory_io.h"

namespace portolan {
namespace {

double Quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto at =
      values.begin() + static_cast<long>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

double CpuSeconds(const rusage& usage) {
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

bool SameFrame(const PlacedPose& a, const PlacedPose& b) {
  if (a.in_world != b.in_world) return false;
  return a.in_world ? a.component == b.component : a.frame_submap == b.frame_submap;
}

}  // namespace

std::string ToText(const RunSummary& s) {
  return absl::StrFormat(
      "agent %s: %d frames (%d tracked, %d dropped, %d skipped, lost %d times), %.2f ms a frame "
      "(p95 %.2f), CPU %.2f ms a frame, %.0f MB, %d submaps, up %.2f kB/s, down %.2f kB/s%s",
      s.agent, s.frames, s.tracked_frames, s.dropped_frames, s.skipped_frames, s.lost,
      s.frame_ms_median, s.frame_ms_p95, s.cpu_ms_per_frame, s.peak_memory_mb, s.submaps,
      s.sent_kb_per_s(), s.received_kb_per_s(),
      s.pending_submaps > 0 ? absl::StrFormat(", %d submaps wait in the outbox", s.pending_submaps)
                            : "");
}

std::string ToJson(const RunSummary& s) {
  return absl::StrFormat(
      "{\"agent\": \"%s\", \"frames\": %d, \"tracked_frames\": %d, \"dropped_frames\": %d, "
      "\"skipped_frames\": %d, \"lost\": %d, \"submaps\": %d, \"frame_ms_median\": %.3f, "
      "\"frame_ms_p95\": %.3f, \"cpu_ms_per_frame\": %.3f, \"landmarks_per_frame\": %.1f, "
      "\"peak_memory_mb\": %.1f, "
      "\"duration_s\": %.3f, \"sent_bytes\": %d, \"received_bytes\": %d, "
      "\"sent_kb_per_s\": %.3f, \"received_kb_per_s\": %.3f, \"pending_submaps\": %d}\n",
      s.agent, s.frames, s.tracked_frames, s.dropped_frames, s.skipped_frames, s.lost, s.submaps,
      s.frame_ms_median, s.frame_ms_p95, s.cpu_ms_per_frame, s.landmarks_per_frame,
      s.peak_memory_mb, s.duration_s, s.sent_bytes, s.received_bytes, s.sent_kb_per_s(),
      s.received_kb_per_s(), s.pending_submaps);
}

void RunRecorder::OdometryPiece::Restate(const std::vector<FramePose>& frames) {
  for (const FramePose& frame : frames) {
    const auto it =
        std::lower_bound(poses.begin(), poses.end(), frame.time,
                         [](const auto& pose, Timestamp wanted) { return pose.time < wanted; });
    if (it == poses.end() || it->time != frame.time) continue;
    it->world_from_body = piece_from_submap * frame.submap_from_camera;
  }
}

void RunRecorder::AddFrame(Timestamp time, const FrameResult& result, const PlacedPose& placed,
                           double frame_ms) {
  frame_ms_.push_back(frame_ms);
  if (!first_time_) first_time_ = time;
  last_time_ = time;
  if (result.tracking_failed) ++lost_;
  landmarks_measured_ += result.landmarks_measured;
  if (result.found_scale) {
    // What was known of this submap before was in other units.
    std::erase_if(live_, [&](const LivePoseRecord& record) {
      return !record.placed.in_world && record.placed.frame_submap == result.submap_sequence_number;
    });
  }
  if (!pieces_.empty()) pieces_.back().Restate(result.restated);
  if (result.begins_submap) {
    if (result.link == LinkType::kConnected && !pieces_.empty()) {
      auto& piece = pieces_.back();
      piece.piece_from_submap = piece.piece_from_submap * result.predecessor_from_submap;
    } else {
      pieces_.emplace_back();
    }
  }
  if (!result.tracked || pieces_.empty()) return;
  ++tracked_frames_;
  live_.push_back({time, placed});
  auto& piece = pieces_.back();
  piece.poses.push_back({time, piece.piece_from_submap * result.submap_from_camera});
}

Trajectory RunRecorder::Live() const {
  Trajectory live;
  if (live_.empty()) return live;
  const PlacedPose& last = live_.back().placed;
  for (const LivePoseRecord& record : live_) {
    if (SameFrame(record.placed, last))
      live.push_back({record.time, record.placed.frame_from_camera});
  }
  return live;
}

Trajectory RunRecorder::Odometry() const {
  const auto longest = std::max_element(
      pieces_.begin(), pieces_.end(),
      [](const auto& a, const auto& b) { return a.poses.size() < b.poses.size(); });
  return longest == pieces_.end() ? Trajectory() : longest->poses;
}

Trajectory RunRecorder::Corrected(const PoseCorrector& corrector) {
  std::map<ComponentId, Trajectory> components;
  for (const PlacedFrame& frame : corrector.Trajectory()) {
    if (!frame.pose.in_world) continue;
    components[frame.pose.component].push_back({frame.time, frame.pose.frame_from_camera});
  }
  Trajectory largest;
  for (auto& [id, trajectory] : components) {
    if (trajectory.size() > largest.size()) largest = std::move(trajectory);
  }
  return largest;
}

void RunRecorder::Fill(RunSummary* summary) const {
  summary->frames = static_cast<int64_t>(frame_ms_.size());
  summary->tracked_frames = tracked_frames_;
  summary->lost = lost_;
  summary->frame_ms_median = Quantile(frame_ms_, 0.5);
  summary->frame_ms_p95 = Quantile(frame_ms_, 0.95);
  if (first_time_) summary->duration_s = ToSeconds(last_time_ - *first_time_);
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  if (summary->frames > 0) {
    const auto frames = static_cast<double>(summary->frames);
    summary->cpu_ms_per_frame = 1e3 * CpuSeconds(usage) / frames;
    summary->landmarks_per_frame = static_cast<double>(landmarks_measured_) / frames;
  }
  summary->peak_memory_mb = static_cast<double>(usage.ru_maxrss) / 1024.0;
}

Status RunRecorder::WriteAll(const std::filesystem::path& folder, const PoseCorrector& corrector,
                             const RunSummary& summary) const {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    return absl::UnavailableError("cannot make " + folder.string() + ": " + error.message());
  }
  PORTOLAN_RETURN_IF_ERROR(WriteTumTrajectory(Live(), folder / "live.tum"));
  PORTOLAN_RETURN_IF_ERROR(WriteTumTrajectory(Odometry(), folder / "odometry.tum"));
  PORTOLAN_RETURN_IF_ERROR(WriteTumTrajectory(Corrected(corrector), folder / "corrected.tum"));
  std::ofstream json(folder / "summary.json");
  json << ToJson(summary);
  json.close();
  if (!json) return absl::UnavailableError("cannot write " + (folder / "summary.json").string());
  return absl::OkStatus();
}

}  // namespace portolan
