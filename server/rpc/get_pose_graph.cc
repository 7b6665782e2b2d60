#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "common/wire/geometry_wire.h"
#include "server/alignment/submap_link.h"
#include "server/rpc/map_handlers.h"

namespace portolan {
namespace {

constexpr int kMaxItemsOfPage = 256;

// The graph of one version of the map: the fused submaps that the request means, and their edges.
struct PoseGraph {
  std::shared_ptr<const MapSnapshot> snapshot;
  std::vector<const SubmapState*> nodes;
  // Connected neighbours, predecessor first.
  std::vector<std::pair<const SubmapState*, const SubmapState*>> links;
  std::vector<const Closure*> closures;
};

PoseGraph MakeGraph(std::shared_ptr<const MapSnapshot> snapshot, int64_t component) {
  PoseGraph graph;
  std::map<SubmapKey, const SubmapState*> by_key;
  std::map<SubmapId, const SubmapState*> by_id;
  for (const auto& state : snapshot->submaps) {
    if (IsQuarantined(*state)) continue;
    if (component != 0 && state->component.value() != component) continue;
    graph.nodes.push_back(state.get());
    by_id[state->refined->id] = state.get();
    const Submap& raw = *state->refined->raw;
    by_key[raw.key] = state.get();
    if (raw.link != LinkType::kConnected || raw.key.sequence_number == 0) continue;
    SubmapKey predecessor = raw.key;
    --predecessor.sequence_number;
    const auto found = by_key.find(predecessor);
    if (found != by_key.end() && found->second->component == state->component) {
      graph.links.emplace_back(found->second, state.get());
    }
  }
  static const ClosureList kNone;
  for (const Closure& closure : snapshot->closures ? *snapshot->closures : kNone) {
    if (by_id.contains(closure.a) && by_id.contains(closure.b)) graph.closures.push_back(&closure);
  }
  graph.snapshot = std::move(snapshot);
  return graph;
}

void FillNode(const SubmapState& state, v1::PoseGraphNode* node) {
  const Submap& raw = *state.refined->raw;
  node->set_submap_id(state.refined->id.value());
  node->set_component_id(state.component.value());
  node->set_time_ns(raw.keyframes.front().time.count());
  node->set_agent_id(raw.key.agent.value());
  node->set_session_id(raw.key.session.value());
  node->set_sequence_number(raw.key.sequence_number);
  ToProto(state.world_from_submap, node->mutable_world_from_submap());
}

void FillEdge(SubmapId a, SubmapId b, const Similarity3& a_from_b, const Matrix7d& information,
              v1::PoseGraphEdge* edge) {
  edge->set_submap_a(a.value());
  edge->set_submap_b(b.value());
  ToProto(a_from_b, edge->mutable_a_from_b());
  for (int row = 0; row < 7; ++row) {
    for (int column = row; column < 7; ++column) edge->add_information(information(row, column));
  }
}

void FillLink(const SubmapState& predecessor, const SubmapState& successor,
              v1::PoseGraphEdge* edge) {
  const SubmapRelation relation =
      LinkToPredecessor(SubmapLinkOptions(), *predecessor.refined, *successor.refined);
  FillEdge(relation.a, relation.b, relation.a_from_b, relation.information, edge);
  edge->set_kind(v1::EDGE_KIND_LINK);
}

}  // namespace

PageMaker<v1::PoseGraphPage> GetPoseGraph(const ServerContext& server,
                                          const v1::GetPoseGraphRequest& request) {
  return [graph = MakeGraph(server.hub->Get(), request.component_id()), node = size_t{0},
          link = size_t{0}, closure = size_t{0}, is_first = true](v1::PoseGraphPage* page) mutable {
    page->set_map_version(graph.snapshot->version);
    while (node < graph.nodes.size() && page->nodes_size() < kMaxItemsOfPage) {
      FillNode(*graph.nodes[node++], page->add_nodes());
    }
    const bool edges_may_come = node == graph.nodes.size();
    while (edges_may_come && link < graph.links.size() && page->edges_size() < kMaxItemsOfPage) {
      const auto& [predecessor, successor] = graph.links[link++];
      FillLink(*predecessor, *successor, page->add_edges());
    }
    while (edges_may_come && closure < graph.closures.size() &&
           page->edges_size() < kMaxItemsOfPage) {
      const Closure& edge = *graph.closures[closure++];
      v1::PoseGraphEdge* message = page->add_edges();
      FillEdge(edge.a, edge.b, edge.a_from_b, edge.information, message);
      message->set_kind(v1::EDGE_KIND_CLOSURE);
      message->set_match_count(static_cast<uint32_t>(edge.matches.size()));
    }
    const bool is_needed = is_first || page->nodes_size() > 0 || page->edges_size() > 0;
    is_first = false;
    return is_needed;
  };
}

}  // namespace portolan
