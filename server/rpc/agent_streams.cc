#include "server/rpc/agent_streams.h"

#include <utility>

#include "server/rpc/agent_stream.h"

namespace portolan {

bool AgentStreams::Admit() {
  const std::lock_guard lock(mutex_);
  if (count_ >= max_count_) return false;
  ++count_;
  return true;
}

std::shared_ptr<AgentStream> AgentStreams::Register(const SessionName& session,
                                                    const std::shared_ptr<AgentStream>& stream) {
  const std::lock_guard lock(mutex_);
  sessions_->SetConnected(session, true);
  return std::exchange(streams_[session], stream);
}

bool AgentStreams::Leave(const SessionName* session, const AgentStream* stream) {
  const std::lock_guard lock(mutex_);
  --count_;
  if (!session) return false;
  const auto entry = streams_.find(*session);
  if (entry == streams_.end() || entry->second.get() != stream) return false;
  streams_.erase(entry);
  sessions_->SetConnected(*session, false);
  return true;
}

void AgentStreams::EndAll(const Status& status) {
  std::map<SessionName, std::shared_ptr<AgentStream>> streams;
  {
    const std::lock_guard lock(mutex_);
    streams = streams_;
  }
  for (const auto& [session, stream] : streams) stream->End(status);
}

}  // namespace portolan
