// Chooses by information what of a refined submap the joint map goes on with. See README.md.
#ifndef PORTOLAN_SERVER_REDUNDANCY_REDUNDANCY_REMOVER_H_
#define PORTOLAN_SERVER_REDUNDANCY_REDUNDANCY_REMOVER_H_

#include <memory>

#include "common/base/status.h"
#include "server/redundancy/submap_information.h"
#include "server/refinement/refined_submap.h"

namespace portolan {

struct RedundancyOptions {
  // The first so many submaps of a map (by their ids) stay whole: as long as a map is small its
  // adjustments are quick, and agents' live poses hold on to all of its keyframes.
  int whole_submaps = 80;
  // Share of the information on the poses (SubmapInformation::Share) under which no more keyframes
  // or landmarks go; with 1, none goes. README.md has the figures.
  double min_keyframe_information = 0.5;
  double min_landmark_information = 0.9;
  // A submap with a keyframe of whose landmarks' observations less than this share agrees stays
  // whole. Sound ones have 0.8 and more; 0.5 is where something large moved, and which half the map
  // should believe shows when all of it is adjusted with its neighbours.
  double min_agreeing_share = 0.75;
  // Keyframes one after another that may go; their poses are interpolated.
  int max_keyframe_gap = 3;
  // No keyframe that stays is left with fewer landmarks than this; where few are seen, each counts.
  // A landmark stays, too, while a cell of a keyframe's image has no more than so many.
  int min_tracks_of_keyframe = 60;
  int grid_columns = 4;
  int grid_rows = 3;
  int min_tracks_of_cell = 3;
  // Leverage of tracks in the first or last keyframe, which the neighbours share, counts so often.
  double sharing_weight = 2.0;
  // Observations whose squared error in sigmas is under this are what was adjusted.
  double agreeing_chi2 = 16.0;

  Status Validate() const;
};

// Immutable, thread-safe, deterministic.
class RedundancyRemover {
 public:
  static StatusOr<RedundancyRemover> Create(const RedundancyOptions& options);

  // The submap without its redundant landmarks, its redundant keyframes named; the submap itself if
  // nothing goes.
  std::shared_ptr<const RefinedSubmap> Remove(std::shared_ptr<const RefinedSubmap> submap) const;

  // What stays. The submap has landmarks.
  SubmapChoice Choose(const RefinedSubmap& submap) const;

 private:
  explicit RedundancyRemover(const RedundancyOptions& options) : options_(options) {}

  RedundancyOptions options_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_REDUNDANCY_REDUNDANCY_REMOVER_H_
