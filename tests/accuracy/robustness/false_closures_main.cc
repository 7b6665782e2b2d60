// How many wrong closures does the map bear? Takes a fleet's submaps, finds the true closures
// between agents with the product's verifier, adds wrong ones, and prints the error of the map by
// share of wrong ones and by the way in which closures are selected.
//
//   portolan-false-closures                          synthetic fleet
//   portolan-false-closures GROUNDTRUTH FOLDER       recorded submaps (see replay_main.cc)
//
// Wrong closures come alone, each with its own error, or in groups of three that agree with each
// other, as repeated structure makes them. "map" is the product's aligner with its adjustments;
// the other columns are the pose graph alone, ATE in mm (wrong ones accepted / true ones refused).
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "common/trajectory/alignment.h"
#include "common/trajectory/trajectory_io.h"
#include "server/alignment/closure_judge.h"
#include "server/alignment/map_aligner.h"
#include "server/refinement/submap_refiner.h"
#include "server/verification/verifier.h"
#include "tests/accuracy/robustness/recorded_mission.h"
#include "tests/support/synthetic_submaps.h"

namespace portolan {
namespace {

constexpr int kSeeds = 5;
constexpr double kShares[] = {0, 0.1, 0.3, 0.5, 0.7};
constexpr struct {
  const char* name;
  ClosureSelection selection;
} kMethods[] = {{"PCM", ClosureSelection::kPairwise},
                {"GNC", ClosureSelection::kGraduated},
                {"PCM, GNC", ClosureSelection::kPairwiseThenGraduated},
                {"PCM start, GNC", ClosureSelection::kPairwiseStart}};

struct Fleet {
  std::vector<std::shared_ptr<const RefinedSubmap>> submaps;  // ids from 1
  std::vector<std::vector<Eigen::Vector3d>> true_positions;   // of the keyframes, metres
  std::vector<Relation> links;
  std::vector<Closure> closures;  // between agents
};

void AddLinksAndClosures(Fleet* fleet) {
  const Verifier verifier = Verifier::Create({}).value();
  const auto& submaps = fleet->submaps;
  for (size_t i = 0; i < submaps.size(); ++i) {
    const SubmapKey& key = submaps[i]->raw->key;
    for (size_t j = 0; j < submaps.size(); ++j) {
      const SubmapKey& other = submaps[j]->raw->key;
      if (other.agent != key.agent) {
        if (j < i) continue;
        const auto closure = verifier.Verify(*submaps[i], *submaps[j]);
        if (closure) fleet->closures.push_back(*closure);
      } else if (other.sequence_number + 1 == key.sequence_number &&
                 submaps[i]->raw->link == LinkType::kConnected) {
        const SubmapRelation link = LinkToPredecessor({}, *submaps[j], *submaps[i]);
        fleet->links.push_back(
            {static_cast<int>(j), static_cast<int>(i), link.a_from_b, link.information, false});
      }
    }
  }
}

Fleet SyntheticFleet(uint32_t seed) {
  SyntheticSubmapsOptions options;
  options.seed = seed;
  options.agents = {{0, 3.2, 6, 1.5}, {1.6, 4.8, 6, 1.4}, {3.2, 6.4, 6, 1.6}, {4.8, 8.0, 6, 1.5}};
  options.drift_rotation_rad = 0.002;
  const SyntheticMission mission = MakeSyntheticMission(options);
  const SubmapRefiner refiner = SubmapRefiner::Create({}).value();
  Fleet fleet;
  for (const SyntheticSubmap& submap : mission.submaps) {
    fleet.submaps.push_back(refiner.Refine(submap.id, submap.submap, mission.camera));
    std::vector<Eigen::Vector3d>& positions = fleet.true_positions.emplace_back();
    for (const Rigid3& pose : submap.world_from_camera) positions.push_back(pose.translation);
  }
  AddLinksAndClosures(&fleet);
  return fleet;
}

StatusOr<Fleet> RecordedFleet(const std::string& groundtruth_file, const std::string& folder) {
  PORTOLAN_ASSIGN_OR_RETURN(const Trajectory groundtruth, ReadTrajectory(groundtruth_file));
  PORTOLAN_ASSIGN_OR_RETURN(const RecordedMission mission, ReadRecordedMission(folder));
  PORTOLAN_ASSIGN_OR_RETURN(const SubmapRefiner refiner, SubmapRefiner::Create({}));
  Fleet fleet;
  for (const SubmapInput& input : Interleave(mission, 0)) {
    const auto refined = refiner.Refine(input.id, input.submap, input.camera);
    if (!refined->quarantine_reason.empty()) {
      return absl::FailedPreconditionError("a submap was quarantined");
    }
    fleet.submaps.push_back(refined);
    std::vector<Eigen::Vector3d>& positions = fleet.true_positions.emplace_back();
    for (const Keyframe& keyframe : input.submap->keyframes) {
      const auto pose = InterpolatePose(groundtruth, keyframe.time);
      if (!pose) return absl::FailedPreconditionError("a keyframe has no ground truth");
      positions.push_back(pose->translation);
    }
  }
  AddLinksAndClosures(&fleet);
  return fleet;
}

// A closure between two random submaps of two agents that is off by more than any covariance.
Closure MakeWrong(const Fleet& fleet, std::mt19937* random) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  Closure closure = fleet.closures[(*random)() % fleet.closures.size()];
  size_t a = 0, b = 0;
  do {
    a = (*random)() % fleet.submaps.size();
    b = (*random)() % fleet.submaps.size();
  } while (fleet.submaps[a]->raw->key.agent == fleet.submaps[b]->raw->key.agent);
  closure.a = fleet.submaps[std::min(a, b)]->id;
  closure.b = fleet.submaps[std::max(a, b)]->id;
  Vector7d error;
  for (int i = 0; i < 7; ++i) error[i] = uniform(*random);
  error.head<3>() *= 3;
  error.segment<3>(3) *= 1.5;
  error[6] *= 0.3;
  closure.a_from_b = closure.a_from_b * Similarity3::Exp(error);
  // Tracks that exist on both sides, paired at random.
  const size_t count = closure.matches.size();
  closure.matches.clear();
  const auto& in_a = fleet.submaps[std::min(a, b)]->landmarks;
  const auto& in_b = fleet.submaps[std::max(a, b)]->landmarks;
  for (size_t i = 0; i < std::min({count, in_a.size(), in_b.size()}); ++i) {
    closure.matches.push_back({in_a[i].track, in_b[i].track});
  }
  return closure;
}

// Another wrong closure that agrees with `first` along the links: between its ends' successors.
std::optional<Closure> NextInGroup(const Fleet& fleet, const Closure& first) {
  Closure next = first;
  const auto follow = [&](SubmapId id, Similarity3* from_next) -> std::optional<SubmapId> {
    for (const Relation& link : fleet.links) {
      if (link.a + 1 != id.value()) continue;
      *from_next = link.a_from_b;
      return SubmapId(link.b + 1);
    }
    return std::nullopt;
  };
  Similarity3 a_from_next, b_from_next;
  const auto a = follow(first.a, &a_from_next), b = follow(first.b, &b_from_next);
  if (!a || !b) return std::nullopt;
  next.a = *a;
  next.b = *b;
  next.a_from_b = a_from_next.Inverse() * first.a_from_b * b_from_next;
  next.matches.clear();
  const auto& in_a = fleet.submaps[a->value() - 1]->landmarks;
  const auto& in_b = fleet.submaps[b->value() - 1]->landmarks;
  for (size_t i = 0; i < std::min({first.matches.size(), in_a.size(), in_b.size()}); ++i) {
    next.matches.push_back({in_a[i].track, in_b[i].track});
  }
  return next;
}

std::vector<Closure> MakeWrongOnes(const Fleet& fleet, double share, bool grouped, uint32_t seed) {
  std::mt19937 random(seed);
  const size_t count = std::lround(share / (1 - share) * fleet.closures.size());
  std::vector<Closure> wrong;
  while (wrong.size() < count) {
    wrong.push_back(MakeWrong(fleet, &random));
    for (int i = 0; grouped && i < 2 && wrong.size() < count; ++i) {
      const auto next = NextInGroup(fleet, wrong.back());
      if (!next) break;
      wrong.push_back(*next);
    }
  }
  return wrong;
}

double Ate(const Fleet& fleet, const std::vector<Eigen::Vector3d>& estimate) {
  std::vector<Eigen::Vector3d> truth;
  for (const auto& positions : fleet.true_positions) {
    truth.insert(truth.end(), positions.begin(), positions.end());
  }
  return AlignedRms(estimate, truth);
}

struct Score {
  double ate_m = 0;
  int wrong_accepted = 0;
  int true_refused = 0;
};

Score JudgeGraph(const Fleet& fleet, const std::vector<Closure>& wrong,
                 ClosureSelection selection) {
  std::vector<Relation> relations = fleet.links;
  std::vector<int> support(relations.size(), 0);
  const MapAlignerOptions defaults;
  for (const auto* closures : {&fleet.closures, &wrong}) {
    for (const Closure& closure : *closures) {
      Matrix7d covariance = closure.information.inverse();
      covariance.diagonal().array() += 1e-4;  // as the aligner's floors
      covariance(6, 6) += 3e-4;
      relations.push_back({static_cast<int>(closure.a.value()) - 1,
                           static_cast<int>(closure.b.value()) - 1, closure.a_from_b,
                           covariance.inverse(), true});
      support.push_back(static_cast<int>(closure.matches.size()));
    }
  }
  ClosureJudgeOptions options;
  options.selection = selection;
  const JudgedFleet judged =
      JudgeClosures(options, static_cast<int>(fleet.submaps.size()), relations, support);
  Score score;
  for (size_t i = fleet.links.size(); i < relations.size(); ++i) {
    const bool is_true = i < fleet.links.size() + fleet.closures.size();
    score.true_refused += is_true && !judged.accepted[i];
    score.wrong_accepted += !is_true && judged.accepted[i];
  }
  std::vector<Eigen::Vector3d> estimate;
  for (size_t i = 0; i < fleet.submaps.size(); ++i) {
    for (const Rigid3& pose : fleet.submaps[i]->submap_from_camera) {
      estimate.push_back(judged.world_from_node[i] * pose.translation);
    }
  }
  score.ate_m = Ate(fleet, estimate);
  return score;
}

// The product: closures arrive with their younger submap, wrong ones first.
Score BuildMap(const Fleet& fleet, const std::vector<Closure>& wrong) {
  MapAligner aligner{MapAlignerOptions()};
  const std::atomic<bool> never = false;
  for (const auto& submap : fleet.submaps) {
    aligner.AddSubmap(submap);
    std::vector<Closure> closures;
    for (const auto* list : {&wrong, &fleet.closures}) {
      for (const Closure& closure : *list) {
        if (std::max(closure.a, closure.b) == submap->id) closures.push_back(closure);
      }
    }
    aligner.AddClosures(closures);
    aligner.AdjustAround(submap->id);
  }
  while (aligner.HasBackgroundWork() || aligner.HasUnsettled()) {
    if (aligner.HasBackgroundWork()) {
      aligner.AdjustStaleComponent(never);
    } else {
      aligner.SettleComponent(never);
    }
  }
  Score score;
  std::vector<Eigen::Vector3d> estimate;
  for (const auto& submap : fleet.submaps) {
    for (const Rigid3& pose : aligner.model().submap(submap->id).world_from_camera) {
      estimate.push_back(pose.translation);
    }
  }
  score.ate_m = Ate(fleet, estimate);
  const auto is_in = [](const Closure& closure, const std::vector<Closure>& list) {
    return std::any_of(list.begin(), list.end(), [&](const Closure& other) {
      return closure.a == other.a && closure.b == other.b &&
             (closure.a_from_b.translation - other.a_from_b.translation).norm() == 0;
    });
  };
  int good = 0;
  for (const Closure& closure : aligner.closures()) {
    score.wrong_accepted += is_in(closure, wrong);
    good += is_in(closure, fleet.closures);
  }
  score.true_refused = static_cast<int>(fleet.closures.size()) - good;
  return score;
}

// Mean over the fleets.
template <typename Solve>
Score Mean(const std::vector<Fleet>& fleets, double share, bool grouped, const Solve& solve) {
  Score sum;
  for (size_t i = 0; i < fleets.size(); ++i) {
    const auto wrong = MakeWrongOnes(fleets[i], share, grouped, static_cast<uint32_t>(i) + 1);
    const Score score = solve(fleets[i], wrong);
    sum.ate_m += score.ate_m / fleets.size();
    sum.wrong_accepted += score.wrong_accepted;
    sum.true_refused += score.true_refused;
  }
  return sum;
}

void PrintTable(const std::vector<Fleet>& fleets, bool grouped) {
  std::printf("wrong closures %s\n%6s", grouped ? "in agreeing groups of three" : "alone", "wrong");
  for (const auto& method : kMethods) std::printf(" %21s", method.name);
  std::printf(" %21s\n", "map");
  for (const double share : kShares) {
    std::printf("%5.0f%%", 100 * share);
    const auto print = [](const Score& score) {
      char counts[32];
      std::snprintf(counts, sizeof(counts), "(%d/%d)", score.wrong_accepted, score.true_refused);
      std::printf(" %11.1f %9s", 1e3 * score.ate_m, counts);
      std::fflush(stdout);
    };
    for (const auto& method : kMethods) {
      print(Mean(fleets, share, grouped, [&](const Fleet& fleet, const auto& wrong) {
        return JudgeGraph(fleet, wrong, method.selection);
      }));
    }
    print(Mean({fleets.begin(), fleets.begin() + 1}, share, grouped, BuildMap));
    std::printf("\n");
  }
}

StatusOr<std::vector<Fleet>> MakeFleets(int argc, char** argv) {
  std::vector<Fleet> fleets;
  if (argc == 3) {
    PORTOLAN_ASSIGN_OR_RETURN(Fleet fleet, RecordedFleet(argv[1], argv[2]));
    // One recording, other wrong closures.
    fleets.assign(kSeeds, fleet);
    return fleets;
  }
  for (uint32_t seed = 1; seed <= kSeeds; ++seed) fleets.push_back(SyntheticFleet(seed));
  return fleets;
}

int Main(int argc, char** argv) {
  if (argc != 1 && argc != 3) {
    std::fprintf(stderr, "usage: portolan-false-closures [GROUNDTRUTH FOLDER]\n");
    return 2;
  }
  const auto fleets = MakeFleets(argc, argv);
  if (!fleets.ok()) {
    std::fprintf(stderr, "portolan-false-closures: %s\n",
                 std::string(fleets.status().message()).c_str());
    return 1;
  }
  std::printf("%zu fleets of %zu submaps; the first has %zu true closures between agents\n",
              fleets->size(), fleets->front().submaps.size(), fleets->front().closures.size());
  for (const bool grouped : {false, true}) PrintTable(*fleets, grouped);
  return 0;
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) { return portolan::Main(argc, argv); }
