#include "common/wire/geometry_wire.h"
#include "server/rpc/map_handlers.h"

namespace portolan {
namespace {

constexpr int kMaxSubmapsOfPage = 256;

v1::LinkType ToProto(LinkType link) {
  switch (link) {
    case LinkType::kNone:
      return v1::LINK_TYPE_NONE;
    case LinkType::kConnected:
      return v1::LINK_TYPE_CONNECTED;
    case LinkType::kBroken:
      return v1::LINK_TYPE_BROKEN;
  }
  return v1::LINK_TYPE_UNSPECIFIED;
}

bool Matches(const SubmapState& state, const v1::ListSubmapsRequest& request) {
  const SubmapKey& key = state.refined->raw->key;
  return (request.agent_id().empty() || key.agent.value() == request.agent_id()) &&
         (request.session_id() == 0 || key.session.value() == request.session_id()) &&
         (request.component_id() == 0 || state.component.value() == request.component_id());
}

}  // namespace

void FillSubmapInfo(const SubmapState& state, const SessionTable& sessions,
                    v1::SubmapInfo* message) {
  const RefinedSubmap& refined = *state.refined;
  const Submap& raw = *refined.raw;
  size_t observation_count = 0;
  for (const Keyframe& keyframe : raw.keyframes) observation_count += keyframe.observations.size();
  message->set_submap_id(refined.id.value());
  message->set_agent_id(raw.key.agent.value());
  message->set_session_id(raw.key.session.value());
  message->set_sequence_number(raw.key.sequence_number);
  message->set_link(ToProto(raw.link));
  message->set_metric(raw.metric);
  message->set_component_id(state.component.value());
  message->set_first_time_ns(raw.keyframes.front().time.count());
  message->set_last_time_ns(raw.keyframes.back().time.count());
  message->set_keyframe_count(static_cast<uint32_t>(raw.keyframes.size()));
  message->set_frame_count(static_cast<uint32_t>(raw.frames.size()));
  message->set_observation_count(static_cast<uint32_t>(observation_count));
  message->set_landmark_count(static_cast<uint32_t>(refined.landmarks.size()));
  message->set_rms_reprojection_px(refined.rms_reprojection_px);
  message->set_quarantine_reason(refined.quarantine_reason.substr(0, 512));
  message->set_encoded_bytes(static_cast<uint32_t>(sessions.ByteCount(refined.id)));
  ToProto(state.world_from_submap, message->mutable_world_from_submap());
  for (int i = 0; i < 7; ++i) {
    message->add_covariance_diagonal(static_cast<float>(state.covariance(i, i)));
  }
  message->set_moved_at_version(state.moved_at_version);
}

PageMaker<v1::SubmapPage> ListSubmaps(const ServerContext& server,
                                      const v1::ListSubmapsRequest& request) {
  return [snapshot = server.hub->Get(), sessions = server.sessions, request, next = size_t{0},
          is_first = true](v1::SubmapPage* page) mutable {
    page->set_map_version(snapshot->version);
    for (; next < snapshot->submaps.size() && page->submaps_size() < kMaxSubmapsOfPage; ++next) {
      const SubmapState& state = *snapshot->submaps[next];
      if (Matches(state, request)) FillSubmapInfo(state, *sessions, page->add_submaps());
    }
    // The first page comes even if it is empty: it names the version.
    const bool is_needed = is_first || page->submaps_size() > 0;
    is_first = false;
    return is_needed;
  };
}

}  // namespace portolan
