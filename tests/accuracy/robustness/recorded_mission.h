// The submaps that agents left in their outboxes, as a mission to be replayed through the map
// builder in any order, and the map's error against the ground truth.
#ifndef PORTOLAN_TESTS_ACCURACY_ROBUSTNESS_RECORDED_MISSION_H_
#define PORTOLAN_TESTS_ACCURACY_ROBUSTNESS_RECORDED_MISSION_H_

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/trajectory/trajectory.h"
#include "server/fusion/map_state.h"
#include "server/map_builder.h"

namespace portolan {

struct RecordedMission {
  // By agent, ascending sequence number; ids are not given yet.
  std::vector<std::vector<SubmapInput>> agents;
};

// Reads every outbox under `folder` (FOLDER/AGENT/SESSION), agents in the order of their names.
StatusOr<RecordedMission> ReadRecordedMission(const std::filesystem::path& folder);

// One order in which a server may have committed the submaps, with ids from 1. Each agent's come
// in sequence. Seed 0: by sequence number, then by agent, as in lockstep.
std::vector<SubmapInput> Interleave(const RecordedMission& mission, uint32_t seed);

// By agent; the one named "" is for all that have none of their own.
using GroundTruths = std::map<std::string, Trajectory>;

// A trajectory file for all agents, or a folder with AGENT/groundtruth.txt.
StatusOr<GroundTruths> ReadGroundTruths(const std::filesystem::path& path);

// Of one agent; empty if there is none.
const Trajectory& TruthOf(const GroundTruths& groundtruths, const std::string& agent);

struct MapAccuracy {
  int components = 0;       // quarantined submaps not counted
  double ate_m = 0;         // all frames, one Sim(3) for all agents
  double worst_part_m = 0;  // the largest ATE of a component that is aligned alone
  double coverage = 0;
  double path_m = 0;  // of all agents
};

// Each component's frames are a part of their agent's trajectory; parts that do not hang together
// have no common frame, which `ate_m` shows as in the product's table.
StatusOr<MapAccuracy> EvaluateMap(const MapSnapshot& snapshot, const GroundTruths& groundtruths);

}  // namespace portolan

#endif  // PORTOLAN_TESTS_ACCURACY_ROBUSTNESS_RECORDED_MISSION_H_
