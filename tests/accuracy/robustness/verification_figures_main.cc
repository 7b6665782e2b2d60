// What verification says about every pair of recorded submaps, held against the ground truth.
//
//   portolan-verification-figures --groundtruth PATH [--verbose] FOLDER...
//
// PATH is a trajectory file for all agents or a folder with AGENT/groundtruth.txt; a FOLDER holds
// one recording (see replay_main.cc). Pairs that are nearer than three in one
// session are left out, as the map builder does. "Near" are pairs with described cameras within a
// quarter of the scene's depth and 20 degrees of each other.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/trajectory/trajectory_io.h"
#include "server/refinement/submap_refiner.h"
#include "server/verification/verifier.h"
#include "tests/accuracy/robustness/placed_submap.h"
#include "tests/accuracy/robustness/recorded_mission.h"

namespace portolan {
namespace {

struct Totals {
  int pairs = 0, near = 0, accepted = 0, accepted_near = 0, wrong = 0;
  std::vector<double> degrees, translation_of_depth, log_scale, rms_px;
  std::vector<double> milliseconds;
  std::map<std::string, int> refusals_of_near;
};

class Figures {
 public:
  Figures(const Verifier& verifier, bool verbose) : verifier_(verifier), verbose_(verbose) {}

  void Judge(const PlacedByTruth& a, const PlacedByTruth& b) {
    const bool near = IsNear(a, b);
    ++totals_.pairs;
    totals_.near += near;
    VerificationReport report;
    const auto start = std::chrono::steady_clock::now();
    const auto closure = verifier_.Verify(*a.refined, *b.refined, &report);
    totals_.milliseconds.push_back(
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
            .count());
    if (!closure) {
      if (near) ++totals_.refusals_of_near[report.refusal];
      if (verbose_ && report.evidence > 60) PrintReport(a, b, near, report);
      return;
    }
    ++totals_.accepted;
    totals_.accepted_near += near;
    const Similarity3 truth = a.world_from_submap.Inverse() * b.world_from_submap;
    const Vector7d error = (truth.Inverse() * closure->a_from_b).Log();
    const double degrees = error.segment<3>(3).norm() * 180 / M_PI;
    const double translation = error.head<3>().norm() * b.world_from_submap.scale / b.depth_m;
    totals_.wrong += degrees > 5 || translation > 0.15 || std::abs(error[6]) > 0.3;
    totals_.degrees.push_back(degrees);
    totals_.translation_of_depth.push_back(translation);
    totals_.log_scale.push_back(std::abs(error[6]));
    totals_.rms_px.push_back(closure->rms_px);
    if (!verbose_) return;
    PrintReport(a, b, near, report);
    std::printf("        %.2f deg, %.3f of depth, log scale %.3f, rms %.1f px\n", degrees,
                translation, error[6], closure->rms_px);
  }

  void Print() {
    std::printf("%d pairs, %d near; accepted %d (%d of the near), %d wrong\n", totals_.pairs,
                totals_.near, totals_.accepted, totals_.accepted_near, totals_.wrong);
    PrintSpread("error, degrees", &totals_.degrees);
    PrintSpread("error, share of depth", &totals_.translation_of_depth);
    PrintSpread("error, log scale", &totals_.log_scale);
    PrintSpread("rms px", &totals_.rms_px);
    PrintSpread("ms a pair", &totals_.milliseconds);
    for (const auto& [reason, count] : totals_.refusals_of_near) {
      std::printf("near but refused, %-20s %d\n", reason.c_str(), count);
    }
  }

 private:
  static void PrintSpread(const char* name, std::vector<double>* values) {
    if (values->empty()) return;
    std::sort(values->begin(), values->end());
    std::printf("%-22s median %.3f, p95 %.3f, most %.3f\n", name, (*values)[values->size() / 2],
                (*values)[values->size() * 95 / 100], values->back());
  }

  static void PrintReport(const PlacedByTruth& a, const PlacedByTruth& b, bool near,
                          const VerificationReport& report) {
    const SubmapKey &x = a.refined->raw->key, &y = b.refined->raw->key;
    std::printf(
        "%s/%u %s/%u %s evidence %.0f (%d of %d) inliers %d/%d share %.2f visible %.2f even %.2f "
        "cells %d rival %.2f sigma %.4f %.4f %.4f %s\n",
        x.agent.value().c_str(), x.sequence_number, y.agent.value().c_str(), y.sequence_number,
        near ? "near" : "    ", report.evidence, report.ransac_inliers, report.putative_matches,
        report.inliers, report.landmark_matches, report.inlier_share, report.visible_share,
        report.evenness, report.cells, report.rival_share, report.rotation_sigma_rad,
        report.log_scale_sigma, report.relative_translation_sigma, report.refusal.c_str());
  }

  const Verifier& verifier_;
  const bool verbose_;
  Totals totals_;
};

Status Run(const std::string& groundtruth_path, bool verbose,
           const std::vector<std::string>& folders) {
  PORTOLAN_ASSIGN_OR_RETURN(const GroundTruths groundtruths, ReadGroundTruths(groundtruth_path));
  PORTOLAN_ASSIGN_OR_RETURN(const Verifier verifier, Verifier::Create({}));
  PORTOLAN_ASSIGN_OR_RETURN(const SubmapRefiner refiner, SubmapRefiner::Create({}));
  Figures figures(verifier, verbose);
  for (const std::string& folder : folders) {
    PORTOLAN_ASSIGN_OR_RETURN(const RecordedMission mission, ReadRecordedMission(folder));
    std::vector<PlacedByTruth> placed;
    for (const SubmapInput& input : Interleave(mission, 0)) {
      const std::string& agent = input.submap->key.agent.value();
      const Trajectory& truth = TruthOf(groundtruths, agent);
      if (truth.empty()) {
        return absl::NotFoundError(
            absl::StrCat("no ground truth for agent ", agent, " in ", groundtruth_path));
      }
      const auto refined = refiner.Refine(input.id, input.submap, input.camera);
      auto submap = PlaceByTruth(refined, truth);
      if (verbose) {
        std::printf(
            "%s/%u: %zu keyframes, %zu landmarks, rms %.2f px, %s scale %.3f depth %.2f "
            "motion %.3f\n",
            input.submap->key.agent.value().c_str(), input.submap->key.sequence_number,
            input.submap->keyframes.size(), refined->landmarks.size(), refined->rms_reprojection_px,
            refined->quarantine_reason.c_str(), submap ? submap->world_from_submap.scale : 0.0,
            submap ? submap->depth_m : 0.0, submap ? submap->motion_agreement : 0.0);
      }
      if (submap) placed.push_back(*std::move(submap));
    }
    for (size_t i = 0; i < placed.size(); ++i) {
      for (size_t j = i + 1; j < placed.size(); ++j) {
        if (IsCandidate(*placed[i].refined, *placed[j].refined)) {
          figures.Judge(placed[i], placed[j]);
        }
      }
    }
  }
  figures.Print();
  return absl::OkStatus();
}

int Main(int argc, char** argv) {
  std::string groundtruth;
  bool verbose = false;
  std::vector<std::string> folders;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--groundtruth" && i + 1 < argc) {
      groundtruth = argv[++i];
    } else if (word == "--verbose") {
      verbose = true;
    } else {
      folders.push_back(word);
    }
  }
  if (groundtruth.empty() || folders.empty()) {
    std::fprintf(stderr,
                 "usage: portolan-verification-figures --groundtruth PATH [--verbose] FOLDER...\n");
    return 2;
  }
  const Status status = Run(groundtruth, verbose, folders);
  if (status.ok()) return 0;
  std::fprintf(stderr, "portolan-verification-figures: %s\n",
               std::string(status.message()).c_str());
  return 1;
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) { return portolan::Main(argc, argv); }
