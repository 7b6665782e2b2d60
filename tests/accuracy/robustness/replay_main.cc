// Replays recorded submaps through the map builder again and again, in other orders, with other
// seeds and with the background work at other times, and prints what the maps are like. A part
// whose own ATE exceeds 3 % of the agents' mean path was put together wrongly.
//
//   portolan-replay --groundtruth PATH [--runs N] [--first-run N] [--no-background] [--verbose]
//                   [--keyframe-information S] [--landmark-information S] FOLDER...
//
// The shares are those of server/redundancy; 1 keeps everything. With either, no submap stays whole
// for being one of the first (whole_submaps is 0). The last columns are what the map
// goes on with (keyframes, landmarks of submaps, the landmarks that it publishes, and observations)
// and the CPU time of the background work.
//
// PATH is a trajectory file for all agents or a folder with AGENT/groundtruth.txt. A FOLDER holds
// one recording: AGENT/SESSION/*.submap, the outboxes of agents that ran without a server. Run 0 of
// each takes the submaps in lockstep order with all background work done after each.
#include <time.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "tests/accuracy/robustness/recorded_mission.h"

namespace portolan {
namespace {

constexpr double kMaxPartErrorOfPath = 0.03;

struct Arguments {
  std::string groundtruth;
  int runs = 3;
  int first_run = 0;
  bool background = true;
  bool verbose = false;
  RedundancyOptions redundancy;
  std::vector<std::string> folders;
};

struct ReplayedMap {
  std::shared_ptr<const MapSnapshot> snapshot;
  double background_s = 0;
};

double ThreadSeconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

void FinishBackground(MapBuilder* builder, ReplayedMap* replayed) {
  const double start = ThreadSeconds();
  const std::atomic<bool> never = false;
  while (builder->HasBackgroundWork()) builder->RunBackgroundWork(never);
  replayed->background_s += ThreadSeconds() - start;
}

StatusOr<ReplayedMap> Replay(const RecordedMission& mission, int run, bool background,
                             const RedundancyOptions& redundancy) {
  ReplayedMap replayed;
  MapBuilderOptions options;
  options.redundancy = redundancy;
  options.verifier.ransac.seed = static_cast<uint32_t>(run) + 1;
  PORTOLAN_ASSIGN_OR_RETURN(const std::unique_ptr<MapBuilder> builder, MapBuilder::Create(options));
  std::mt19937 random(static_cast<uint32_t>(run) * 7919);
  for (const SubmapInput& input : Interleave(mission, static_cast<uint32_t>(run))) {
    builder->IntegrateSubmap(input);
    if (background && (run == 0 || random() % 3 == 0)) {
      FinishBackground(builder.get(), &replayed);
    }
  }
  const double start = ThreadSeconds();
  if (background) builder->SettleCompletely();
  replayed.background_s += ThreadSeconds() - start;
  replayed.snapshot = builder->snapshot();
  return replayed;
}

// What the map's adjustments see of its submaps.
void PrintContents(const MapSnapshot& snapshot) {
  size_t keyframes = 0, landmarks = 0, observations = 0, published = 0;
  for (const auto& state : snapshot.submaps) {
    const RefinedSubmap& refined = *state->refined;
    landmarks += refined.landmarks.size();
    published += state->landmarks.size();
    for (size_t k = 0; k < refined.raw->keyframes.size(); ++k) {
      if (IsRedundant(refined, static_cast<int>(k))) continue;
      ++keyframes;
      for (const Observation& observation : refined.raw->keyframes[k].observations) {
        observations += FindLandmark(refined, observation.track) != nullptr ? 1 : 0;
      }
    }
  }
  std::printf(" %9zu %9zu %9zu %12zu", keyframes, landmarks, published, observations);
}

void PrintClosures(const MapSnapshot& snapshot) {
  const auto print = [&](const char* kind, const auto& closures) {
    for (const Closure& closure : closures) {
      std::printf("  %s %lld-%lld matches %zu rms %.2f px\n", kind,
                  static_cast<long long>(closure.a.value()),
                  static_cast<long long>(closure.b.value()), closure.matches.size(),
                  closure.rms_px);
    }
  };
  if (snapshot.closures) print("accepted", *snapshot.closures);
  if (snapshot.waiting_closures) print("waiting ", *snapshot.waiting_closures);
}

Status Run(const Arguments& arguments) {
  PORTOLAN_ASSIGN_OR_RETURN(const GroundTruths groundtruth,
                            ReadGroundTruths(arguments.groundtruth));
  std::printf("%-28s %4s %6s %9s %9s %9s %9s %9s %9s %9s %9s %12s %6s\n", "recording", "run",
              "parts", "ATE mm", "% path", "part mm", "coverage", "closures", "keyframes",
              "landmarks", "published", "observations", "CPU s");
  std::vector<double> errors;
  int whole = 0, wrong = 0;
  for (const std::string& folder : arguments.folders) {
    PORTOLAN_ASSIGN_OR_RETURN(const RecordedMission mission, ReadRecordedMission(folder));
    for (int run = arguments.first_run; run < arguments.first_run + arguments.runs; ++run) {
      PORTOLAN_ASSIGN_OR_RETURN(const ReplayedMap replayed,
                                Replay(mission, run, arguments.background, arguments.redundancy));
      const std::shared_ptr<const MapSnapshot>& snapshot = replayed.snapshot;
      PORTOLAN_ASSIGN_OR_RETURN(const MapAccuracy accuracy, EvaluateMap(*snapshot, groundtruth));
      const double mean_path_m = accuracy.path_m / mission.agents.size();
      std::printf("%-28s %4d %6d %9.1f %9.2f %9.1f %9.3f %9zu",
                  std::filesystem::path(folder).filename().c_str(), run, accuracy.components,
                  1e3 * accuracy.ate_m, 100 * accuracy.ate_m / mean_path_m,
                  1e3 * accuracy.worst_part_m, accuracy.coverage,
                  snapshot->closures ? snapshot->closures->size() : 0);
      PrintContents(*snapshot);
      std::printf(" %6.2f\n", replayed.background_s);
      if (arguments.verbose) PrintClosures(*snapshot);
      std::fflush(stdout);
      errors.push_back(1e3 * accuracy.ate_m);
      whole += accuracy.components == 1;
      wrong +=
          accuracy.worst_part_m > kMaxPartErrorOfPath * accuracy.path_m / mission.agents.size();
    }
  }
  if (errors.empty()) return absl::InvalidArgumentError("no recording given");
  std::sort(errors.begin(), errors.end());
  std::printf(
      "%d of %zu runs in one part, %d with a wrong part; ATE mm: least %.1f, median %.1f, most "
      "%.1f\n",
      whole, errors.size(), wrong, errors.front(), errors[errors.size() / 2], errors.back());
  return absl::OkStatus();
}

int Main(int argc, char** argv) {
  Arguments arguments;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--groundtruth" && i + 1 < argc) {
      arguments.groundtruth = argv[++i];
    } else if (word == "--runs" && i + 1 < argc) {
      arguments.runs = std::max(1, std::atoi(argv[++i]));
    } else if (word == "--first-run" && i + 1 < argc) {
      arguments.first_run = std::max(0, std::atoi(argv[++i]));
    } else if (word == "--keyframe-information" && i + 1 < argc) {
      arguments.redundancy.min_keyframe_information = std::atof(argv[++i]);
      arguments.redundancy.whole_submaps = 0;
    } else if (word == "--landmark-information" && i + 1 < argc) {
      arguments.redundancy.min_landmark_information = std::atof(argv[++i]);
      arguments.redundancy.whole_submaps = 0;
    } else if (word == "--no-background") {
      arguments.background = false;
    } else if (word == "--verbose") {
      arguments.verbose = true;
    } else {
      arguments.folders.push_back(word);
    }
  }
  if (arguments.groundtruth.empty() || arguments.folders.empty()) {
    std::fprintf(
        stderr,
        "usage: portolan-replay --groundtruth PATH [--runs N] [--first-run N]\n"
        "    [--no-background] [--verbose] FOLDER...\n"
        "    [--keyframe-information S] [--landmark-information S]   redundancy, from the\n"
        "        first submap on (whole_submaps 0); without, from the 81st\n");
    return 2;
  }
  const Status status = Run(arguments);
  if (status.ok()) return 0;
  std::fprintf(stderr, "portolan-replay: %s\n", std::string(status.message()).c_str());
  return 1;
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) { return portolan::Main(argc, argv); }
