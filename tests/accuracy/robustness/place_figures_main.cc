// Place recognition on recorded submaps: recall@5 against the ground truth and time of a query, in
// maps of 100, 1,000 and 10,000 submaps.
//
//   portolan-place-figures GROUNDTRUTH FOLDER [DISTRACTOR_FOLDER...]
//
// FOLDER holds one recording (see replay_main.cc); its submaps are asked for. The map is filled up
// with distractors: recorded submaps (of FOLDER and the further folders in turn) in whose
// descriptors every bit is flipped with probability 1/4, which keeps what descriptors have in
// common and is as far from the original as unrelated points are. A query counts if a submap exists
// that is near by the truth and no neighbour in the session; it succeeds if one is among five.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "common/trajectory/trajectory_io.h"
#include "server/place_recognition/place_index.h"
#include "server/refinement/submap_refiner.h"
#include "tests/accuracy/robustness/placed_submap.h"
#include "tests/accuracy/robustness/recorded_mission.h"

namespace portolan {
namespace {

constexpr int kSizes[] = {100, 1000, 10000};

Submap MakeDistractor(const Submap& submap, std::mt19937_64* random) {
  Submap distractor = submap;
  for (Keyframe& keyframe : distractor.keyframes) {
    for (Feature& feature : keyframe.features) {
      for (uint64_t& word : feature.descriptor.words) word ^= (*random)() & (*random)();
    }
  }
  return distractor;
}

struct Places {
  std::vector<PlacedByTruth> known;                     // ids from 1
  std::vector<std::shared_ptr<const Submap>> patterns;  // of distractors
};

StatusOr<Places> ReadPlaces(const std::vector<std::string>& arguments) {
  PORTOLAN_ASSIGN_OR_RETURN(const Trajectory groundtruth, ReadTrajectory(arguments[0]));
  PORTOLAN_ASSIGN_OR_RETURN(const SubmapRefiner refiner, SubmapRefiner::Create({}));
  Places places;
  for (size_t i = 1; i < arguments.size(); ++i) {
    PORTOLAN_ASSIGN_OR_RETURN(const RecordedMission mission, ReadRecordedMission(arguments[i]));
    for (const SubmapInput& input : Interleave(mission, 0)) {
      places.patterns.push_back(input.submap);
      if (i > 1) continue;
      auto placed = PlaceByTruth(refiner.Refine(input.id, input.submap, input.camera), groundtruth);
      if (placed) places.known.push_back(*std::move(placed));
    }
  }
  return places;
}

void Ask(const Places& places, const PlaceIndex& index) {
  int asked = 0, found = 0;
  std::vector<double> milliseconds;
  for (const PlacedByTruth& query : places.known) {
    std::vector<SubmapId> near, neighbours;
    for (const PlacedByTruth& other : places.known) {
      if (!IsCandidate(*query.refined, *other.refined)) {
        neighbours.push_back(other.refined->id);
      } else if (IsNear(query, other)) {
        near.push_back(other.refined->id);
      }
    }
    const auto start = std::chrono::steady_clock::now();
    const auto candidates = index.Query(*query.refined->raw, 5, [&](SubmapId id) {
      return std::find(neighbours.begin(), neighbours.end(), id) == neighbours.end();
    });
    milliseconds.push_back(
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
            .count());
    if (near.empty()) continue;
    ++asked;
    found += std::any_of(candidates.begin(), candidates.end(), [&](const PlaceCandidate& c) {
      return std::find(near.begin(), near.end(), c.submap) != near.end();
    });
  }
  std::sort(milliseconds.begin(), milliseconds.end());
  std::printf("%8d %8d %10.3f %10.1f %10.1f\n", index.submap_count(), asked,
              static_cast<double>(found) / std::max(asked, 1),
              milliseconds[milliseconds.size() / 2], milliseconds[milliseconds.size() * 95 / 100]);
  std::fflush(stdout);
}

Status Run(const std::vector<std::string>& arguments) {
  PORTOLAN_ASSIGN_OR_RETURN(const Places places, ReadPlaces(arguments));
  if (places.known.empty()) return absl::InvalidArgumentError("no submap has ground truth");
  PORTOLAN_ASSIGN_OR_RETURN(const std::unique_ptr<PlaceIndex> index, PlaceIndex::Create({}));
  for (const PlacedByTruth& place : places.known) {
    index->Add(place.refined->id, place.refined->raw);
  }
  std::printf("%8s %8s %10s %10s %10s\n", "submaps", "queries", "recall@5", "median ms", "p95 ms");
  Ask(places, *index);
  std::mt19937_64 random(1);
  int64_t next = static_cast<int64_t>(places.patterns.size()) + 1;
  for (const int size : kSizes) {
    for (; index->submap_count() < size; ++next) {
      const Submap& pattern = *places.patterns[next % places.patterns.size()];
      index->Add(SubmapId(next), std::make_shared<const Submap>(MakeDistractor(pattern, &random)));
    }
    Ask(places, *index);
  }
  return absl::OkStatus();
}

int Main(int argc, char** argv) {
  if (argc < 3) {
    std::fprintf(stderr,
                 "usage: portolan-place-figures GROUNDTRUTH FOLDER [DISTRACTOR_FOLDER...]\n");
    return 2;
  }
  const Status status = Run(std::vector<std::string>(argv + 1, argv + argc));
  if (status.ok()) return 0;
  std::fprintf(stderr, "portolan-place-figures: %s\n", std::string(status.message()).c_str());
  return 1;
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) { return portolan::Main(argc, argv); }
