// The agents' streams that are open, one a session.
#ifndef PORTOLAN_SERVER_RPC_AGENT_STREAMS_H_
#define PORTOLAN_SERVER_RPC_AGENT_STREAMS_H_

#include <map>
#include <memory>
#include <mutex>

#include "server/ingest/session_table.h"

namespace portolan {

class AgentStream;

// Thread-safe.
class AgentStreams {
 public:
  // Keeps `sessions`, which must outlive it, informed of who is connected.
  AgentStreams(int max_count, SessionTable* sessions)
      : max_count_(max_count), sessions_(sessions) {}

  // Counts a new stream; false if there are too many.
  bool Admit();
  // The stream speaks for the session from now on. Returns the one that did before, if any.
  std::shared_ptr<AgentStream> Register(const SessionName& session,
                                        const std::shared_ptr<AgentStream>& stream);
  // An admitted stream ends. True if it spoke for the session.
  bool Leave(const SessionName* session, const AgentStream* stream);
  // Ends all streams that speak for a session.
  void EndAll(const Status& status);

 private:
  const int max_count_;
  SessionTable* const sessions_;
  std::mutex mutex_;
  // Guarded by mutex_.
  int count_ = 0;
  std::map<SessionName, std::shared_ptr<AgentStream>> streams_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_RPC_AGENT_STREAMS_H_
