// What holds the submaps of a component together: links between neighbours of a session and
// accepted closures; and how uncertain chains of them are.
#ifndef PORTOLAN_SERVER_ALIGNMENT_SUBMAP_RELATIONS_H_
#define PORTOLAN_SERVER_ALIGNMENT_SUBMAP_RELATIONS_H_

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <unordered_map>
#include <vector>

#include "server/alignment/closure_list.h"
#include "server/alignment/map_model.h"
#include "server/verification/pairwise_consistency.h"

namespace portolan {

struct SubmapRelationsOptions {
  // Standard deviations that closures are not believed beyond: their landmarks share errors.
  double closure_translation_floor_of_depth = 0.01;
  double closure_rotation_floor_rad = 0.01;
  double closure_log_scale_floor = 0.02;
  // Submaps that the search for a chain between two visits at most; a longer chain is so uncertain
  // that it decides nothing.
  int max_chain_search = 3000;

  Status Validate() const;
};

// Keeps, for every submap, the chain with the fewest members to its component's oldest submap, and
// its covariance; what a new submap or closure changes costs no more than what changes.
// Thread-compatible. The model passed in is always the same one.
class SubmapRelations {
 public:
  struct Neighbour {
    SubmapId submap;
    Similarity3 from_neighbour;  // this submap's frame from the neighbour's
    Matrix7d covariance;         // of its right perturbation
  };

  explicit SubmapRelations(const SubmapRelationsOptions& options) : options_(options) {}

  const ClosureList& closures() const { return closures_; }
  // Indices into closures().
  const std::vector<size_t>& ClosuresOf(SubmapId id) const;
  // Of the right perturbation of a_from_b.
  Matrix7d FlooredCovariance(const MapModel& model, const Closure& closure) const;
  const Matrix7d& CovarianceOf(size_t closure) const { return covariances_[closure]; }

  // After the model took the submap.
  void AddSubmap(const MapModel& model, SubmapId id);
  void AddClosure(const MapModel& model, std::shared_ptr<const Closure> closure);
  // Chains through them keep their covariance until Rechain.
  void EraseClosures(const std::function<bool(const Closure&)>& predicate);
  // Finds the chains of these submaps anew, after they joined or left a component.
  void Rechain(const MapModel& model, const std::vector<SubmapId>& submaps);

  std::vector<Neighbour> NeighboursOf(const MapModel& model, SubmapId id) const;
  // Names only, in the same order.
  std::vector<SubmapId> NeighbourNames(const MapModel& model, SubmapId id) const;
  // Along the chain with the fewest members; no value if there is none or it is too long.
  std::optional<UncertainSimilarity> Relative(const MapModel& model, SubmapId a, SubmapId b) const;
  // Of the right perturbation of world_from_submap, relative to the component's oldest submap.
  Matrix7d Covariance(SubmapId id) const;

 private:
  struct Chain {
    int length = 0;
    Matrix7d covariance = Matrix7d::Zero();
  };

  // Shortens chains through the given submaps, whose own are known.
  void Propagate(const MapModel& model, std::vector<SubmapId> front);

  SubmapRelationsOptions options_;
  ClosureList closures_;
  std::vector<Matrix7d> covariances_;  // parallel, floored
  std::unordered_map<SubmapId, std::vector<size_t>> closures_of_;
  std::unordered_map<SubmapId, Chain> chains_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_SUBMAP_RELATIONS_H_
