// What the agent says next on its stream and what it makes of the answers; no thread, no socket.
#ifndef PORTOLAN_AGENT_UPLINK_UPLINK_PROTOCOL_H_
#define PORTOLAN_AGENT_UPLINK_UPLINK_PROTOCOL_H_

#include <cstdint>
#include <optional>
#include <set>
#include <string>

#include "agent/uplink/outbox.h"
#include "common/base/status.h"
#include "common/base/time.h"
#include "common/submap/map_correction.h"
#include "common/wire/agent_wire.h"
#include "proto/agent_service.pb.h"

namespace portolan {

struct UplinkProtocolOptions {
  // Uploads under way without acknowledgement; fills a slow link, and bounds what is sent twice
  // after a break.
  int window = 8;
  // Live poses are sent at most so often; newer ones replace those that wait.
  Duration live_pose_interval = std::chrono::milliseconds(100);
  // A submap is set aside as rejected after so many streams that the server ended with
  // INVALID_ARGUMENT while it was the first one unacknowledged.
  int max_invalid_ends = 3;
  // What the server may send of landmark offers, bytes a second.
  int offered_bytes_per_second = 0;

  Status Validate() const;
};

// Counters since the start; bytes are serialised messages plus an estimate of the framing: 5
// bytes (gRPC) a message and 9 bytes (HTTP/2 DATA) for each 16 kB begun. TLS, HTTP/2 control
// frames, TCP and IP are not in it.
struct UplinkStats {
  bool connected = false;  // Welcome was received on the present stream
  uint64_t streams = 0;    // opened so far, failed ones included
  uint64_t sent_submaps = 0;
  uint64_t accepted_submaps = 0;
  uint64_t rejected_submaps = 0;
  uint64_t corrupted_submaps = 0;  // damaged on disk
  uint64_t sent_live_poses = 0;
  uint64_t received_corrections = 0;
  uint64_t malformed_messages = 0;  // from the server, ignored
  uint64_t sent_bytes = 0;
  uint64_t received_bytes = 0;
  uint64_t received_map_version = 0;
  std::string last_error;  // for the operator
};

// Thread-compatible; UplinkSession guards it. Protocol of use, for each stream: StartStream once,
// send what it and then Next return, hand every answer to OnMessage, StreamEnded once.
class UplinkProtocol {
 public:
  // `outbox` must outlive it.
  UplinkProtocol(Outbox* outbox, const UplinkProtocolOptions& options);

  v1::AgentMessage StartStream();
  // What to send now, if anything.
  std::optional<v1::AgentMessage> Next(Duration now);
  // When Next may have something by the passing of time alone.
  std::optional<Duration> NextDue() const;
  // A correction to hand on, if that is what came. Malformed and unexpected messages are counted
  // and ignored.
  std::optional<MapCorrection> OnMessage(const v1::ServerMessage& message);
  void StreamEnded(const Status& status);

  // Replaces a pose that waits. Invalid poses (not finite) are dropped.
  void SetLivePose(const LivePose& pose);
  // From now on Finish is sent whenever nothing is pending.
  void RequestFinish() { finish_requested_ = true; }
  // The server has answered Finish.
  bool finished() const { return finished_; }

  const UplinkStats& stats() const { return stats_; }

 private:
  std::optional<v1::AgentMessage> NextSubmap();
  std::optional<v1::AgentMessage> NextLivePose(Duration now);
  void OnWelcome(const v1::Welcome& welcome);
  void OnAck(const v1::SubmapAck& ack);
  std::optional<MapCorrection> OnCorrection(const v1::Correction& message);
  void OnMalformed(const std::string& what);
  v1::AgentMessage Counted(v1::AgentMessage message);

  Outbox* const outbox_;
  const UplinkProtocolOptions options_;
  UplinkStats stats_;
  bool finish_requested_ = false;
  bool finished_ = false;
  std::optional<LivePose> live_pose_;
  std::optional<Duration> last_live_pose_;

  // Of the present stream.
  bool welcomed_ = false;
  bool finish_sent_ = false;
  bool corrections_damaged_ = false;  // a part of a version was malformed
  uint32_t next_to_send_ = 0;
  std::set<uint32_t> unacknowledged_;

  // Of the stream's ends with INVALID_ARGUMENT.
  std::optional<uint32_t> suspect_;
  int suspect_ends_ = 0;
};

// See UplinkStats.
uint64_t WireBytes(uint64_t message_bytes);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_UPLINK_UPLINK_PROTOCOL_H_
