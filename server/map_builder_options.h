// Options of the map builder: those of its stages.
#ifndef PORTOLAN_SERVER_MAP_BUILDER_OPTIONS_H_
#define PORTOLAN_SERVER_MAP_BUILDER_OPTIONS_H_

#include "common/base/status.h"
#include "server/alignment/map_aligner.h"
#include "server/fusion/map_fuser.h"
#include "server/place_recognition/place_index.h"
#include "server/redundancy/redundancy_remover.h"
#include "server/refinement/submap_refiner.h"
#include "server/verification/verifier.h"

namespace portolan {

struct MapBuilderOptions {
  SubmapRefinerOptions refiner;
  RedundancyOptions redundancy;
  PlaceIndexOptions place_index;
  VerifierOptions verifier;
  MapAlignerOptions aligner;
  MapFuserOptions fuser;
  // Places that are verified for each submap; every closure more makes the map more accurate, and
  // a failed verification costs some milliseconds.
  int max_candidates = 8;
  // Once the map is larger than aligner.full_component_submaps, so many closures are enough for a
  // submap: more of them repeat what its neighbours say.
  int enough_closures = 3;
  // Submaps of the same session nearer than this in the sequence share tracks; closing with them
  // adds nothing.
  int min_sequence_distance = 2;
  // Threads of Ceres, which solves adjustments of more than 8,000 cameras only; takes precedence
  // over the stages' own. With one, results repeat; with more, the order of its sums may change.
  int num_threads = 1;

  Status Validate() const;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_MAP_BUILDER_OPTIONS_H_
