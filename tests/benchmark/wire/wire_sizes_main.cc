// Bytes by field of recorded submaps: of the sessions that wait in the outbox folders of runs with
// --server none.
//
//   portolan-wire-sizes OUTBOX...
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <string>

#include "agent/uplink/outbox.h"
#include "common/wire/submap_wire.h"

namespace portolan {
namespace {

struct Totals {
  WireSizes sizes;
  size_t submaps = 0, keyframes = 0, observations = 0, features = 0, landmarks = 0, frames = 0;
  double seconds = 0;
};

void Add(const WireSizes& more, WireSizes* sum) {
  sum->keyframe_poses += more.keyframe_poses;
  sum->keyframe_covariances += more.keyframe_covariances;
  sum->observation_tracks += more.observation_tracks;
  sum->observation_pixels += more.observation_pixels;
  sum->observation_sigmas += more.observation_sigmas;
  sum->feature_pixels += more.feature_pixels;
  sum->feature_attributes += more.feature_attributes;
  sum->feature_descriptors += more.feature_descriptors;
  sum->landmarks += more.landmarks;
  sum->frame_times += more.frame_times;
  sum->frame_poses += more.frame_poses;
  sum->other += more.other;
}

void Count(const Submap& submap, Totals* totals) {
  ++totals->submaps;
  totals->keyframes += submap.keyframes.size();
  for (const Keyframe& keyframe : submap.keyframes) {
    totals->observations += keyframe.observations.size();
    totals->features += keyframe.features.size();
  }
  totals->landmarks += submap.landmarks.size();
  totals->frames += submap.frames.size();
  totals->seconds += ToSeconds(submap.keyframes.back().time - submap.keyframes.front().time);
}

// What the present program makes of a recorded submap, whatever wrote it.
Status AddRecorded(const std::string& bytes, Totals* totals) {
  PORTOLAN_ASSIGN_OR_RETURN(const Submap submap, DecodeSubmap(bytes));
  v1::Submap message;
  PORTOLAN_RETURN_IF_ERROR(ToProto(submap, &message));
  Add(SizesOf(message), &totals->sizes);
  Count(submap, totals);
  return absl::OkStatus();
}

Status AddFolder(const std::filesystem::path& folder, Totals* totals) {
  PORTOLAN_ASSIGN_OR_RETURN(const auto outbox, Outbox::Open(folder, OutboxOptions()));
  for (auto i = outbox->NextPending(0); i; i = outbox->NextPending(*i + 1)) {
    PORTOLAN_ASSIGN_OR_RETURN(const std::string bytes, outbox->Read(*i));
    PORTOLAN_RETURN_IF_ERROR(AddRecorded(bytes, totals));
  }
  return absl::OkStatus();
}

void Print(const Totals& t) {
  const WireSizes& s = t.sizes;
  std::printf("%zu submaps, %.1f s\n", t.submaps, t.seconds);
  const auto print = [&t](const char* name, size_t bytes, size_t count, const char* of) {
    std::printf("%-22s %8.0f B/s %5.1f %% %8.2f bytes a %s\n", name,
                static_cast<double>(bytes) / t.seconds,
                100.0 * static_cast<double>(bytes) / static_cast<double>(t.sizes.Total()),
                static_cast<double>(bytes) / static_cast<double>(std::max<size_t>(count, 1)), of);
  };
  print("keyframe poses", s.keyframe_poses, t.keyframes, "keyframe");
  print("keyframe covariances", s.keyframe_covariances, t.keyframes, "keyframe");
  print("observation tracks", s.observation_tracks, t.observations, "observation");
  print("observation pixels", s.observation_pixels, t.observations, "observation");
  print("observation sigmas", s.observation_sigmas, t.observations, "observation");
  print("feature pixels", s.feature_pixels, t.features, "feature");
  print("feature attributes", s.feature_attributes, t.features, "feature");
  print("feature descriptors", s.feature_descriptors, t.features, "feature");
  print("landmarks", s.landmarks, t.landmarks, "landmark");
  print("frame times", s.frame_times, t.frames, "frame");
  print("frame poses", s.frame_poses, t.frames, "frame");
  print("tags and lengths", s.other, t.submaps, "submap");
  print("total", s.Total(), t.submaps, "submap");
}

Status Run(int argc, char** argv) {
  Totals totals;
  for (int i = 1; i < argc; ++i) {
    for (const auto& folder : Outbox::FindPendingSessions(argv[i])) {
      PORTOLAN_RETURN_IF_ERROR(AddFolder(folder, &totals));
    }
  }
  if (totals.submaps == 0) return absl::InvalidArgumentError("no submaps in the given outboxes");
  Print(totals);
  return absl::OkStatus();
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  const portolan::Status status = portolan::Run(argc, argv);
  if (status.ok()) return 0;
  std::fprintf(stderr, "error: %s\n", std::string(status.message()).c_str());
  return 1;
}
