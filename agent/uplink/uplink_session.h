// Carries one session's submaps to the server and its corrections back.
#ifndef PORTOLAN_AGENT_UPLINK_UPLINK_SESSION_H_
#define PORTOLAN_AGENT_UPLINK_UPLINK_SESSION_H_

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "agent/uplink/outbox.h"
#include "agent/uplink/uplink_protocol.h"
#include "common/base/status.h"
#include "common/concurrency/backoff.h"
#include "common/concurrency/clock.h"
#include "common/submap/submap.h"

namespace grpc {
class ClientContext;
}  // namespace grpc

namespace portolan {

struct UplinkOptions {
  // host:port of the server.
  std::string server_address = "127.0.0.1:50800";
  UplinkProtocolOptions protocol;
  BackoffOptions backoff;
  // A TCP connection must come up within this time.
  Duration connect_timeout = std::chrono::seconds(5);
  // A silent server is asked for a sign of life this often; radio links die without a word.
  Duration keepalive_interval = std::chrono::seconds(20);
  // It is given up when it does not answer within this time.
  Duration keepalive_timeout = std::chrono::seconds(10);

  Status Validate() const;
};

// Calling protocol: Start, then Submit and SetLivePose at will, Finish, Shutdown (the destructor
// shuts down, too). Works without a server: submaps wait on disk. Thread-safe; Submit is called
// by one thread.
class UplinkSession {
 public:
  // Called on the uplink's reading thread, without a lock, in the order of arrival; validated.
  using CorrectionCallback = std::function<void(const MapCorrection&)>;

  // `jitter_seed` spreads the reconnections of a fleet. `clock` (for back-off and rates) outlives
  // the session.
  static StatusOr<std::unique_ptr<UplinkSession>> Create(const UplinkOptions& options,
                                                         std::unique_ptr<Outbox> outbox,
                                                         uint64_t jitter_seed,
                                                         CorrectionCallback on_correction,
                                                         Clock* clock = SteadyClock::Get());
  ~UplinkSession();
  UplinkSession(const UplinkSession&) = delete;
  UplinkSession& operator=(const UplinkSession&) = delete;

  void Start();

  // On disk for good when it returns OK (takes as long as a flush to disk); never waits for the
  // network. InvalidArgument if the submap is malformed, ResourceExhausted if the outbox is full.
  Status Submit(const Submap& submap);

  // Sends the pose if the stream is up and the rate allows; a newer one replaces it. Never waits.
  void SetLivePose(const LivePose& pose);

  // Says that no more submaps follow and waits until the server has everything and has settled.
  // Then the outbox' folder is removed if nothing was set aside. DeadlineExceeded after `timeout`
  // (of the clock): the session goes on trying, what is pending stays on disk. Cancelled if
  // Shutdown came first.
  Status Finish(Duration timeout);

  // Ends the stream and the threads; pending submaps stay on disk.
  void Shutdown();

  UplinkStats stats() const;
  size_t pending_submaps() const { return outbox_->pending_count(); }
  SessionId session() const { return outbox_->hello().session; }

 private:
  UplinkSession(const UplinkOptions& options, std::unique_ptr<Outbox> outbox, uint64_t jitter_seed,
                CorrectionCallback on_correction, Clock* clock);
  struct Stream;

  // The uplink's thread: streams, one after the other, with back-off.
  void Run();
  Status RunStream();
  // Reads until the stream ends.
  void ReadAll(Stream* stream);
  // Writes what the protocol has to say until the stream ends, the session is finished, or
  // Shutdown.
  void WriteAll(Stream* stream);
  // Whether WriteAll has something to do.
  bool MustWake(const Stream& stream) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const UplinkOptions options_;
  const std::unique_ptr<Outbox> outbox_;
  const CorrectionCallback on_correction_;
  Clock* const clock_;
  Backoff backoff_;  // of the uplink's thread

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  UplinkProtocol protocol_ ABSL_GUARDED_BY(mutex_);
  bool news_ ABSL_GUARDED_BY(mutex_) = false;  // the protocol may have something to say
  bool shutdown_ ABSL_GUARDED_BY(mutex_) = false;
  grpc::ClientContext* context_ ABSL_GUARDED_BY(mutex_) = nullptr;  // of the present stream
  std::thread thread_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_UPLINK_UPLINK_SESSION_H_
