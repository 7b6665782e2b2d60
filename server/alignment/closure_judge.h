// Decides anew, from the links and all closures of a fleet, which closures to believe and where
// that places the submaps; no earlier decision counts.
#ifndef PORTOLAN_SERVER_ALIGNMENT_CLOSURE_JUDGE_H_
#define PORTOLAN_SERVER_ALIGNMENT_CLOSURE_JUDGE_H_

#include <vector>

#include "common/base/status.h"
#include "server/alignment/relation_graph.h"
#include "server/verification/pairwise_consistency.h"

namespace portolan {

// How closures are selected. "Pairwise" is the largest consistent set of each pair of chains
// (Mangelson et al., ICRA 2018), "graduated" is graduated non-convexity over the whole graph (Yang
// et al., RA-L 2020).
enum class ClosureSelection {
  kPairwise,               // the consistent sets, solved without further doubt
  kGraduated,              // all closures, from a chordal start
  kPairwiseThenGraduated,  // the consistent sets, graduated
  kPairwiseStart,          // the consistent sets place the chains, then all closures, graduated
};

struct ClosureJudgeOptions {
  // Published experience says that pairwise consistency before graduated non-convexity can lose
  // good closures; as its start it loses none (figures: tests/accuracy/README.md).
  ClosureSelection selection = ClosureSelection::kPairwiseStart;
  PairwiseConsistencyOptions consistency;
  RelationGraphOptions graph;
  // Two chains join by one closure with this much support, or by two or more that agree.
  int min_support_of_single = 40;

  Status Validate() const;
};

// Links are the relations that are not doubtful; they form chains without branches or loops. The
// others are closures.
struct JudgedFleet {
  std::vector<Similarity3> world_from_node;  // a world for each part, that of its first node
  std::vector<bool> accepted;                // parallel to the relations; links are
  std::vector<int> part_of_node;             // the part's first node
};

// `support` is parallel to `relations`: matched landmarks of a closure. Deterministic.
JudgedFleet JudgeClosures(const ClosureJudgeOptions& options, int node_count,
                          const std::vector<Relation>& relations, const std::vector<int>& support);

// Poses that satisfy all relations in the least squares sense of the chordal relaxation: log
// scales, then rotations, then positions, each linear. The first node of each part is the
// identity; needs no start.
std::vector<Similarity3> ChordalStart(int node_count, const std::vector<Relation>& relations);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_CLOSURE_JUDGE_H_
