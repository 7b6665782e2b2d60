// Integrates a replayed fleet in this process and prints, at 100, 300, 1,000, 3,000 and 10,000
// submaps, what a submap costs in each stage, the memory and the error of the map.
//
//   replay_benchmark [--submaps 1000] [--agents 100] [--visits 3] [--seed 1]
//                    [--background_ms 0]   background work after each submap, interrupted then
//                    [--polish]            background work to its end, and settling, at the end
//                    [--rebuild]           the same from the raw submaps once more
//                    [--keyframe_information S] [--landmark_information S] [--whole_submaps N]
//                                          see server/redundancy; shares of 1 keep everything, and
//                                          so does N for the first N (80); its README's figures
//                                          are with --whole_submaps 0
#include <time.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <iterator>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "server/map_builder.h"
#include "server/query/landmark_index.h"
#include "tests/benchmark/replay/map_error.h"
#include "tests/benchmark/replay/process_memory.h"
#include "tests/support/replay_fleet.h"

namespace portolan {
namespace {

using Clock = std::chrono::steady_clock;

double MillisecondsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

// Time that this thread computed; unlike the wall clock, the same on a busy machine.
double ThreadMilliseconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

double Quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const size_t place = static_cast<size_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(place),
                   values.end());
  return values[place];
}

// Runs background work and interrupts it after a while.
double RunBackground(MapBuilder* builder, double limit_ms) {
  const Clock::time_point start = Clock::now();
  std::atomic<bool> interrupt = false;
  std::mutex mutex;
  std::condition_variable done;
  bool is_done = false;
  std::thread timer([&] {
    std::unique_lock lock(mutex);
    done.wait_for(lock, std::chrono::duration<double, std::milli>(limit_ms),
                  [&] { return is_done; });
    interrupt = true;
  });
  while (!interrupt && builder->HasBackgroundWork()) builder->RunBackgroundWork(interrupt);
  {
    const std::lock_guard lock(mutex);
    is_done = true;
  }
  done.notify_one();
  timer.join();
  return MillisecondsSince(start);
}

class Replay {
 public:
  explicit Replay(const std::map<std::string, double>& flags)
      : submaps_(static_cast<int>(flags.at("submaps"))),
        background_ms_(flags.at("background_ms")),
        fleet_(ReplayFleetOptions::For(submaps_, static_cast<int>(flags.at("agents")),
                                       flags.at("visits"),
                                       static_cast<uint64_t>(flags.at("seed")))),
        options_(OptionsOf(flags)),
        builder_(std::move(MapBuilder::Create(options_)).value()) {}

  void Run(bool polish, bool rebuild) {
    std::printf(
        "submaps | integrate wall ms median p95 max | CPU ms median p95 | wall ms refine link "
        "recognise verify align fuse | background ms a step, to its interrupt p95 | components "
        "closures right wrong, waiting right wrong | ATE mm | RSS MB | index CPU ms\n");
    for (int i = 1; i <= submaps_; ++i) {
      Integrate(i);
      if (i == submaps_ || i == 100 || i == 300 || i == 1000 || i == 3000) Report(i);
    }
    if (polish) Settle(builder_.get());
    if (rebuild) Rebuild();
  }

 private:
  static MapBuilderOptions OptionsOf(const std::map<std::string, double>& flags) {
    MapBuilderOptions options;
    options.redundancy.min_keyframe_information = flags.at("keyframe_information");
    options.redundancy.min_landmark_information = flags.at("landmark_information");
    options.redundancy.whole_submaps = static_cast<int>(flags.at("whole_submaps"));
    return options;
  }

  void Integrate(int number) {
    ReplaySubmap submap = fleet_.Next();
    truth_.push_back(std::move(submap.world_from_camera));
    const Clock::time_point start = Clock::now();
    const double cpu_start = ThreadMilliseconds();
    builder_->IntegrateSubmap({SubmapId(number), std::move(submap.submap), fleet_.camera()});
    integrate_ms_.push_back(MillisecondsSince(start));
    cpu_ms_.push_back(ThreadMilliseconds() - cpu_start);
    if (background_ms_ > 0) background_.push_back(RunBackground(builder_.get(), background_ms_));
    const double index_start = ThreadMilliseconds();
    index_ = LandmarkIndex::Build(builder_->snapshot(), index_.get());
    index_ms_ = ThreadMilliseconds() - index_start;
  }

  void Settle(MapBuilder* builder) {
    const Clock::time_point start = Clock::now();
    const double cpu_start = ThreadMilliseconds();
    builder->SettleCompletely();
    const MapError error = ErrorOf(*builder->snapshot(), truth_);
    std::printf("settled in %.1f s (CPU %.1f s): ATE %.1f mm of %d submaps, %d components\n",
                MillisecondsSince(start) / 1000, (ThreadMilliseconds() - cpu_start) / 1000,
                1000 * error.ate_m, error.submaps, error.components);
  }

  // As `portolan-server --rebuild` does: all raw submaps once more, background work at the end.
  void Rebuild() {
    const auto builder = std::move(MapBuilder::Create(options_)).value();
    for (const auto& state : builder_->snapshot()->submaps) {
      builder->IntegrateSubmap(
          {state->refined->id, state->refined->raw, state->refined->camera, state->refined});
    }
    std::printf("rebuilt; ");
    Settle(builder.get());
    const std::set<std::pair<SubmapId, SubmapId>> live = ClosuresOf(*builder_->snapshot());
    const std::set<std::pair<SubmapId, SubmapId>> again = ClosuresOf(*builder->snapshot());
    std::vector<std::pair<SubmapId, SubmapId>> both;
    std::set_intersection(live.begin(), live.end(), again.begin(), again.end(),
                          std::back_inserter(both));
    std::printf("closures: %zu, rebuilt %zu, in both %zu; the maps are %.1f mm apart\n",
                live.size(), again.size(), both.size(),
                1000 * DistanceBetween(*builder_->snapshot(), *builder->snapshot(), truth_));
  }

  static std::set<std::pair<SubmapId, SubmapId>> ClosuresOf(const MapSnapshot& snapshot) {
    std::set<std::pair<SubmapId, SubmapId>> closures;
    for (const Closure& closure : *snapshot.closures) closures.emplace(closure.a, closure.b);
    return closures;
  }

  static double MeanMs(const StageTime& now, const StageTime& before) {
    return (now.total_ms - before.total_ms) /
           std::max(1.0, static_cast<double>(now.count - before.count));
  }

  void Report(int number) {
    const size_t recent = std::min<size_t>(integrate_ms_.size(), std::max(50, number / 10));
    const std::vector<double> last(integrate_ms_.end() - static_cast<std::ptrdiff_t>(recent),
                                   integrate_ms_.end());
    const std::vector<double> last_cpu(cpu_ms_.end() - static_cast<std::ptrdiff_t>(recent),
                                       cpu_ms_.end());
    const StageTimes now = builder_->stage_times();
    const auto snapshot = builder_->snapshot();
    const MapError error = ErrorOf(*snapshot, truth_);
    std::printf(
        "%6d | %6.1f %6.1f %7.1f | %6.1f %6.1f | %5.1f %5.2f %5.1f %6.1f %6.1f %5.1f | %6.1f %6.1f "
        "| %4d %6d %d, %d %d | "
        "%8.1f of %5d (%d quarantined, %.0f m) | %6.0f | %5.2f\n",
        number, Quantile(last, 0.5), Quantile(last, 0.95), Quantile(last, 1),
        Quantile(last_cpu, 0.5), Quantile(last_cpu, 0.95), MeanMs(now.refine, before_.refine),
        MeanMs(now.link, before_.link), MeanMs(now.recognise, before_.recognise),
        MeanMs(now.verify, before_.verify), MeanMs(now.align, before_.align),
        MeanMs(now.fuse, before_.fuse), MeanMs(now.background, before_.background),
        Quantile(background_, 0.95), error.components, error.accepted_right, error.accepted_wrong,
        error.waiting_right, error.waiting_wrong, 1000 * error.ate_m, error.submaps,
        error.quarantined, error.path_m, ProcessMemoryMb("self", "VmRSS"), index_ms_);
    std::fflush(stdout);
    before_ = now;
    background_.clear();
  }

  const int submaps_;
  const double background_ms_;
  ReplayFleet fleet_;
  const MapBuilderOptions options_;
  std::unique_ptr<MapBuilder> builder_;
  std::shared_ptr<const LandmarkIndex> index_;
  std::vector<std::vector<Rigid3>> truth_;
  std::vector<double> integrate_ms_;
  std::vector<double> cpu_ms_;
  std::vector<double> background_;
  double index_ms_ = 0;
  StageTimes before_;
};

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  std::map<std::string, double> flags = {
      {"submaps", 1000}, {"agents", 100}, {"visits", 3}, {"seed", 1}, {"background_ms", 0}};
  const portolan::RedundancyOptions redundancy;
  flags["keyframe_information"] = redundancy.min_keyframe_information;
  flags["landmark_information"] = redundancy.min_landmark_information;
  flags["whole_submaps"] = redundancy.whole_submaps;
  bool polish = false;
  bool rebuild = false;
  for (int i = 1; i < argc; ++i) {
    const std::string name = std::string(argv[i]).substr(0, 2) == "--" ? argv[i] + 2 : "";
    if (name == "polish") {
      polish = true;
    } else if (name == "rebuild") {
      rebuild = true;
    } else if (flags.contains(name) && i + 1 < argc) {
      flags[name] = std::stod(argv[++i]);
    } else {
      std::fprintf(stderr, "unknown argument %s\n", argv[i]);
      return 2;
    }
  }
  portolan::Replay(flags).Run(polish, rebuild);
  return 0;
}
