#include "agent/agent_runner.h"

#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <utility>

#include "common/base/logging.h"
#include "common/wire/submap_wire.h"

namespace portolan {
namespace {

constexpr char kSoftwareVersion[] = "portolan 0.1.0";
constexpr int64_t kProgressFrames = 10;
// Odometry comes at 10 Hz and more; so the sample after an image is there.
constexpr Duration kOdometryLookahead = std::chrono::milliseconds(110);

double MillisecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

std::optional<Rigid3> PredecessorOf(const FrameResult& result) {
  if (result.link != LinkType::kConnected) return std::nullopt;
  return result.predecessor_from_submap;
}

// Where the second camera sits, which has to be known of both cameras in one frame.
StatusOr<StereoMount> FindSecondCamera(const ImageSourceInfo& info) {
  const auto& body_from_first = info.calibration.body_from_camera;
  const auto& body_from_second = info.right_calibration->body_from_camera;
  if (!body_from_first || !body_from_second) {
    return absl::InvalidArgumentError(
        "the cameras' calibrations do not say where they sit on the vehicle (T_BS), which depths "
        "from two cameras need");
  }
  PORTOLAN_ASSIGN_OR_RETURN(const CameraModel camera,
                            CameraModel::Create(info.right_calibration->intrinsics));
  const Rigid3 second_from_first = body_from_second->Inverse() * *body_from_first;
  if (!(second_from_first.translation.norm() > 1e-4)) {
    return absl::InvalidArgumentError(
        "by their calibrations both cameras sit at the same place: no depth can be told");
  }
  return StereoMount{camera, second_from_first};
}

// The sensors whose samples the source delivers. (Returned in a StatusOr, gcc 12 takes the optional
// mounts for uninitialised.)
Status FindSensors(const ImageSource& source, VehicleSensors* sensors) {
  const ImageSourceInfo& info = source.info();
  if (info.right_calibration) {
    PORTOLAN_ASSIGN_OR_RETURN(sensors->second_camera, FindSecondCamera(info));
  }
  sensors->antenna_in_camera_m = info.antenna_in_camera_m;
  sensors->range_finder = info.range_finder;
  if (!info.imu_calibration && !info.has_odometry) return absl::OkStatus();
  const auto& body_from_camera = source.calibration().body_from_camera;
  if (!body_from_camera) {
    return absl::InvalidArgumentError(
        "the camera's calibration does not say where it sits on the vehicle (T_BS), which the IMU "
        "or odometry needs");
  }
  if (info.has_odometry) sensors->body_from_camera = body_from_camera;
  if (info.imu_calibration) {
    sensors->imu = ImuMount{*info.imu_calibration,
                            info.imu_calibration->body_from_imu.Inverse() * *body_from_camera};
  }
  return absl::OkStatus();
}

}  // namespace

Status RunnerOptions::Validate() const {
  if (agent.empty()) return absl::InvalidArgumentError("agent: a vehicle needs a name");
  if (server.empty()) return absl::InvalidArgumentError("server: host:port or none");
  if (outbox.empty()) return absl::InvalidArgumentError("outbox: a folder is needed");
  if (!(finish_timeout_s >= 0)) {
    return absl::InvalidArgumentError("finish_timeout_s must not be negative");
  }
  if (!(unreachable_timeout_s >= 0)) {
    return absl::InvalidArgumentError("unreachable_timeout_s must not be negative");
  }
  return budget.Validate();
}

StatusOr<std::unique_ptr<AgentRunner>> AgentRunner::Create(const RunnerOptions& runner,
                                                           const AgentOptions& agent_options,
                                                           const UplinkOptions& uplink,
                                                           const OutboxOptions& outbox,
                                                           std::unique_ptr<ImageSource> source) {
  PORTOLAN_RETURN_IF_ERROR(runner.Validate());
  const SessionId session = runner.session == 0 ? DrawSessionId() : SessionId(runner.session);
  PORTOLAN_ASSIGN_OR_RETURN(const CameraModel camera,
                            CameraModel::Create(source->calibration().intrinsics));
  VehicleSensors sensors;
  PORTOLAN_RETURN_IF_ERROR(FindSensors(*source, &sensors));
  PORTOLAN_ASSIGN_OR_RETURN(
      auto agent, Agent::Create(agent_options, camera, AgentId(runner.agent), session, sensors));
  std::unique_ptr<AgentRunner> result(
      new AgentRunner(runner, agent_options, camera, std::move(source), std::move(agent)));
  if (runner.server != "none") result->OpenPendingSessions(uplink, outbox);
  PORTOLAN_RETURN_IF_ERROR(result->OpenUplink(uplink, outbox, session));
  return result;
}

AgentRunner::AgentRunner(const RunnerOptions& options, const AgentOptions& agent_options,
                         const CameraModel& camera, std::unique_ptr<ImageSource> source,
                         std::unique_ptr<Agent> agent)
    : options_(options),
      source_(std::move(source)),
      agent_(std::move(agent)),
      localizer_(agent_options.local_adjustment, agent_options.revisit, camera),
      budget_(options.budget) {
  summary_.agent = options.agent;
  const RevisitOptions& revisit = agent_options.revisit;
  offered_bytes_per_second_ = revisit.enabled ? revisit.offered_bytes_per_second : 0;
}

Status AgentRunner::OpenUplink(const UplinkOptions& uplink, const OutboxOptions& outbox,
                               SessionId session) {
  SessionHello hello;
  hello.agent = AgentId(options_.agent);
  hello.session = session;
  hello.camera = source_->calibration().intrinsics;
  hello.software_version = kSoftwareVersion;
  PORTOLAN_ASSIGN_OR_RETURN(auto box, Outbox::Create(options_.outbox, hello, outbox));
  if (options_.server == "none") {
    offline_outbox_ = std::move(box);
    return absl::OkStatus();
  }
  UplinkOptions with_server = uplink;
  with_server.server_address = options_.server;
  with_server.protocol.offered_bytes_per_second = offered_bytes_per_second_;
  PORTOLAN_ASSIGN_OR_RETURN(
      uplink_, UplinkSession::Create(with_server, std::move(box), session.value(),
                                     [this](const MapCorrection& correction) {
                                       const Status status = corrector_.Apply(correction);
                                       if (!status.ok()) {
                                         LogWarning("correction: ", status.message());
                                       }
                                     }));
  uplink_->Start();
  return absl::OkStatus();
}

void AgentRunner::OpenPendingSessions(const UplinkOptions& uplink, const OutboxOptions& outbox) {
  Outbox::RemoveDoneSessions(options_.outbox);
  UplinkOptions with_server = uplink;
  with_server.server_address = options_.server;
  for (const auto& folder : Outbox::FindPendingSessions(options_.outbox)) {
    auto box = Outbox::Open(folder, outbox);
    if (!box.ok()) {
      LogWarning("outbox ", folder.string(), ": ", box.status().message());
      continue;
    }
    const uint64_t seed = (*box)->hello().session.value();
    auto session =
        UplinkSession::Create(with_server, std::move(*box), seed, [](const MapCorrection&) {});
    if (!session.ok()) {
      LogWarning("outbox ", folder.string(), ": ", session.status().message());
      continue;
    }
    LogInfo("delivering ", (*session)->pending_submaps(), " submaps of an earlier session");
    (*session)->Start();
    earlier_sessions_.push_back(std::move(*session));
  }
}

Status AgentRunner::Run(const std::atomic<bool>& stop) {
  Status status = ProcessImages(stop);
  if (auto last = agent_->Finish()) {
    const Status taken = TakeSubmap(std::move(*last));
    if (status.ok()) status = taken;
  }
  recorder_.Fill(&summary_);
  Deliver();
  const auto& counts = source_->counts();
  summary_.dropped_frames = counts.dropped;
  summary_.skipped_frames += counts.unreadable + counts.out_of_order;
  if (!options_.output.empty()) {
    const Status written = recorder_.WriteAll(options_.output, corrector_, summary_);
    if (status.ok()) status = written;
  }
  return status;
}

Status AgentRunner::ProcessImages(const std::atomic<bool>& stop) {
  while (!stop) {
    PORTOLAN_ASSIGN_OR_RETURN(const auto frame, source_->Next());
    if (!frame) break;
    PORTOLAN_RETURN_IF_ERROR(ProcessFrame(*frame));
  }
  return absl::OkStatus();
}

void AgentRunner::FeedSensors(Timestamp time) {
  const ImageSourceInfo& info = source_->info();
  if (info.imu_calibration) {
    // One sample more, so that the rates at the image's time are interpolated.
    const double rate_hz = info.imu_calibration->rate_hz;
    const Duration period = FromSeconds(rate_hz > 0 ? 1.01 / rate_hz : 0);
    agent_->AddImu(source_->TakeImu(time + period));
  }
  if (info.has_odometry) agent_->AddOdometry(source_->TakeOdometry(time + kOdometryLookahead));
  if (info.range_finder) agent_->AddRanges(source_->TakeRanges(time));
  if (info.has_gnss) agent_->AddGnss(source_->TakeGnss(time));
}

Status AgentRunner::ProcessFrame(const Frame& frame) {
  const auto start = std::chrono::steady_clock::now();
  FeedSensors(frame.time);
  auto result = agent_->ProcessImage(frame.time, frame.gray, frame.right);
  if (!result.ok()) {
    LogWarning(frame.name, ": ", result.status().message());
    ++summary_.skipped_frames;
    return absl::OkStatus();
  }
  if (result->closed_submap) {
    PORTOLAN_RETURN_IF_ERROR(TakeSubmap(std::move(*result->closed_submap)));
  }
  const uint32_t sequence_number = result->submap_sequence_number;
  if (result->begins_submap) corrector_.OpenSubmap(sequence_number, PredecessorOf(*result));
  const PlacedPose placed =
      localizer_.Localize({frame.time, sequence_number, result->begins_submap,
                           PredecessorOf(*result), result->submap_from_camera, result->tracked,
                           result->is_keyframe, result->restated, result->sights, result->features},
                          &corrector_);
  recorder_.AddFrame(frame.time, *result, placed, MillisecondsSince(start));
  if (uplink_ && result->tracked) {
    uplink_->SetLivePose(
        {frame.time, sequence_number, result->submap_from_camera, PredecessorOf(*result)});
  }
  ++summary_.frames;
  ShowProgress(*result, false);
  return absl::OkStatus();
}

Status AgentRunner::TakeSubmap(Submap submap) {
  ++summary_.submaps;
  if (const int left_out = budget_.Fit(&submap); left_out > 0) {
    LogDebug("submap ", submap.key.sequence_number, ": ", left_out,
             " described points left out to keep within the uplink's budget");
  }
  corrector_.CloseSubmap(submap);
  localizer_.AddSubmap(submap);
  if (uplink_) return uplink_->Submit(submap);
  PORTOLAN_ASSIGN_OR_RETURN(const std::string bytes, EncodeSubmap(submap));
  return offline_outbox_->Append(submap.key.sequence_number, bytes);
}

void AgentRunner::ShowProgress(const FrameResult& result, bool last) {
  if (!options_.progress || isatty(STDERR_FILENO) == 0) return;
  if (!last && summary_.frames % kProgressFrames != 0) return;
  const UplinkStats stats = uplink_ ? uplink_->stats() : UplinkStats();
  const std::string total =
      source_->info().frame_count > 0 ? Concat("/", source_->info().frame_count) : std::string();
  std::fprintf(stderr, "\r%s: frame %lld%s, %s, %d landmarks, %d tracks, submap %u, %s, %zu wait  ",
               options_.agent.c_str(), static_cast<long long>(summary_.frames), total.c_str(),
               result.tracked ? "tracking" : "LOST", result.landmarks_measured, result.tracks,
               result.submap_sequence_number, stats.connected ? "connected" : "no server",
               uplink_ ? uplink_->pending_submaps() : size_t{0});
  if (last) std::fputc('\n', stderr);
}

void AgentRunner::Deliver() {
  if (options_.progress && isatty(STDERR_FILENO) != 0) std::fputc('\n', stderr);
  if (!uplink_) {
    summary_.pending_submaps = offline_outbox_->pending_count();
    return;
  }
  for (auto& session : earlier_sessions_) Deliver(*session);
  Deliver(*uplink_);
  const UplinkStats stats = uplink_->stats();
  summary_.sent_bytes = stats.sent_bytes;
  summary_.received_bytes = stats.received_bytes;
  summary_.pending_submaps = uplink_->pending_submaps();
  if (stats.rejected_submaps > 0) {
    LogError(stats.rejected_submaps, " submaps were refused by the server: ", stats.last_error);
  }
}

void AgentRunner::Deliver(UplinkSession& session) {
  const double first_wait_s = std::min(options_.unreachable_timeout_s, options_.finish_timeout_s);
  Status status = session.Finish(FromSeconds(first_wait_s));
  const UplinkStats stats = session.stats();
  const bool reached = stats.connected || stats.accepted_submaps > 0;
  if (absl::IsDeadlineExceeded(status) && reached) {
    status = session.Finish(FromSeconds(options_.finish_timeout_s - first_wait_s));
  }
  if (!status.ok()) {
    LogWarning("delivery: ", status.message(), "; ", session.pending_submaps(), " submaps wait in ",
               options_.outbox, " for the next run",
               reached ? "" : " (no server at " + options_.server + ")");
  }
}

}  // namespace portolan
