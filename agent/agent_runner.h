// Runs an agent over an image source: images in, submaps out to the outbox and the server,
// corrections in, trajectories out. The thin shell that adds threads, files and network.
#ifndef PORTOLAN_AGENT_AGENT_RUNNER_H_
#define PORTOLAN_AGENT_AGENT_RUNNER_H_

#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include "agent/agent.h"
#include "agent/corrections/pose_corrector.h"
#include "agent/image_source/image_source.h"
#include "agent/local_adjustment/live_localizer.h"
#include "agent/run_recorder.h"
#include "agent/submap/submap_budget.h"
#include "agent/uplink/uplink_session.h"
#include "common/base/status.h"

namespace portolan {

struct RunnerOptions {
  // The vehicle's name, unique in the fleet: 1 to 64 characters of A-Z a-z 0-9 . _ -
  std::string agent = "agent";
  // host:port of the server, or "none": the submaps stay in the outbox until a later run.
  std::string server = "127.0.0.1:50800";
  // Folder of the submaps that the server does not have yet.
  std::string outbox = "outbox";
  // Folder for live.tum, odometry.tum, corrected.tum and summary.json; empty: not written.
  std::string output;
  // Longest wait at the end for the server to take everything and to settle [s].
  double finish_timeout_s = 600;
  // If no server was ever reached the end waits only so long [s].
  double unreachable_timeout_s = 5;
  // 0: drawn at random. A fixed one makes the uploaded bytes repeatable.
  uint64_t session = 0;
  // Of the submaps' bytes.
  SubmapBudgetOptions budget;
  // A line of progress on the terminal.
  bool progress = true;

  Status Validate() const;
};

// Protocol: Create, then Run once. Thread-compatible.
class AgentRunner {
 public:
  static StatusOr<std::unique_ptr<AgentRunner>> Create(const RunnerOptions& runner,
                                                       const AgentOptions& agent,
                                                       const UplinkOptions& uplink,
                                                       const OutboxOptions& outbox,
                                                       std::unique_ptr<ImageSource> source);

  // Processes images until the source ends or `stop` is set, closes the last submap, delivers, and
  // writes the output. An error of the source ends the run in the same orderly way and is returned.
  Status Run(const std::atomic<bool>& stop);

  const RunSummary& summary() const { return summary_; }

 private:
  AgentRunner(const RunnerOptions& options, const AgentOptions& agent_options,
              const CameraModel& camera, std::unique_ptr<ImageSource> source,
              std::unique_ptr<Agent> agent);

  Status OpenUplink(const UplinkOptions& uplink, const OutboxOptions& outbox, SessionId session);
  // Sessions that earlier runs could not deliver.
  void OpenPendingSessions(const UplinkOptions& uplink, const OutboxOptions& outbox);
  Status ProcessImages(const std::atomic<bool>& stop);
  Status ProcessFrame(const Frame& frame);
  // Hands the samples up to an image's time to the agent.
  void FeedSensors(Timestamp time);
  Status TakeSubmap(Submap submap);
  void ShowProgress(const FrameResult& result, bool last);
  void Deliver();
  void Deliver(UplinkSession& session);

  const RunnerOptions options_;
  std::unique_ptr<ImageSource> source_;
  std::unique_ptr<Agent> agent_;
  PoseCorrector corrector_;
  LiveLocalizer localizer_;
  SubmapBudget budget_;
  int offered_bytes_per_second_ = 0;
  RunRecorder recorder_;
  RunSummary summary_;
  std::unique_ptr<Outbox> offline_outbox_;  // without a server
  std::unique_ptr<UplinkSession> uplink_;
  std::vector<std::unique_ptr<UplinkSession>> earlier_sessions_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_AGENT_RUNNER_H_
