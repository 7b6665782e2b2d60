// The assembled server: store, map thread, ingest, corrections and gRPC in one object, usable by
// `main` and in the process of a test.
#ifndef PORTOLAN_SERVER_SERVER_H_
#define PORTOLAN_SERVER_SERVER_H_

#include <memory>
#include <string>

#include "common/base/status.h"
#include "common/base/time.h"
#include "server/corrections/correction_planner.h"
#include "server/corrections/offer_planner.h"
#include "server/ingest/ingest.h"
#include "server/pipeline/map_thread.h"
#include "server/store/map_store.h"

namespace grpc {
class Channel;
}

namespace portolan {

struct ServerOptions {
  // The map file; created if there is none.
  std::string map_file;
  // host:port; port 0 takes a free one. Loopback unless the operator says otherwise, as the
  // protocol is neither encrypted nor authenticated.
  std::string listen = "127.0.0.1:50800";
  // Drops everything derived and builds the map anew from the raw submaps.
  bool rebuild = false;
  IngestOptions ingest;
  MapThreadOptions map_thread;
  CorrectionOptions corrections;
  OfferOptions offers;
  // Agents at the same time; each costs some 100 kB.
  int max_agents = 256;
  // Streams on one connection; viewers open a few.
  int max_streams_per_connection = 64;
  // A silent connection is asked for a sign of life this often; one that gives none within
  // keepalive_timeout is closed, and the agent's session is free for its next stream.
  Duration keepalive_interval = std::chrono::seconds(20);
  Duration keepalive_timeout = std::chrono::seconds(10);

  Status Validate() const;
};

// Protocol: Start, then Shutdown or destruction. Thread-safe. Shutdown ends all streams with
// UNAVAILABLE, saves the map and closes the file; what is committed but not integrated is
// integrated after the next start.
class Server {
 public:
  // Opens the file, restores the map in `engine`, and listens. Errors name the file or address.
  static StatusOr<std::unique_ptr<Server>> Start(const ServerOptions& options,
                                                 std::unique_ptr<MapEngine> engine);
  // The same on an open store (`options.map_file` is not used), so that tests inject faults.
  static StatusOr<std::unique_ptr<Server>> Start(const ServerOptions& options,
                                                 std::unique_ptr<MapEngine> engine,
                                                 std::unique_ptr<MapStore> store);
  ~Server();

  // host:port with the actual port; port alone.
  std::string address() const;
  int port() const;
  StageTimes stage_times() const;
  void Shutdown();

 private:
  class Impl;
  explicit Server(std::unique_ptr<Impl> impl);

  std::unique_ptr<Impl> impl_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_SERVER_H_
