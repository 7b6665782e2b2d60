// The coarse half of adjusting a component too large for one bundle adjustment. Regions, their
// surroundings held, remove errors as long as a region; this removes the longer ones.
//
// It minimises the bundle adjustment's own robust reprojection errors over similarities at the
// submaps' ends: what a camera between them moves by is interpolated in the tangent space, so that
// sessions bend but do not break. Landmarks are eliminated. This is Galerkin's coarse correction
// (Trottenberg, Oosterlee, Schueller, "Multigrid", 2001, Sec. 2.4) with linear elements; submaps as
// rigid parts (Ni, Steedly, Dellaert, "Out-of-core bundle adjustment for large-scale 3D
// reconstruction", ICCV 2007) need three times as many rounds.
#ifndef PORTOLAN_SERVER_ALIGNMENT_MAP_RELAXATION_H_
#define PORTOLAN_SERVER_ALIGNMENT_MAP_RELAXATION_H_

#include <atomic>
#include <map>
#include <memory>
#include <vector>

#include "server/alignment/map_adjuster.h"
#include "server/alignment/position_references.h"

namespace portolan {

struct MapRelaxationOptions {
  // Levenberg-Marquardt steps; the regions' turn comes after.
  int max_iterations = 4;
  // Relative decrease of the cost under which a step is the last one. Errors of long wavelength
  // cost little: 1e-4 of the cost is centimetres at the ends of a long session.
  double min_decrease = 1e-5;
  // Cauchy scale of a reprojection error, as in the bundle adjustment.
  double loss_scale_sigmas = 4.0;
  // Squared error, in sigmas, up to which observations take part that the bundle adjustment left
  // out: at a loop that it could not yet close they may well be right.
  double readmitting_chi2 = 64.0;
  // How far a position's error may go before it loses weight, and the like.
  GeoreferenceFitOptions positions;
  // Prior of a landmark's position relative to its distance, which holds those without parallax.
  double distance_prior_relative = 0.5;
  // In maps of more submaps than the first, so many landmarks of each take part: long errors show
  // in a few as well as in all.
  int max_whole_submaps = 300;
  int max_landmarks = 60;

  Status Validate() const;
};

struct RelaxationSummary {
  bool interrupted = false;
  int iterations = 0;  // that were taken
  double initial_cost = 0;
  double final_cost = 0;
};

// Moves the cameras and landmarks of the submaps (a whole component, ascending). The first one's
// start stays, but for its scale if metric submaps tell it. With `positions` (null for none; the
// world is the site frame) everything moves, and the submaps bend so that the terms' places come to
// theirs, too; terms that contradict the others lose weight. Takes time in proportion to the
// observations. Deterministic.
// Works on a copy of what it needs, so that it may go on after the model has changed.
class MapRelaxation {
 public:
  MapRelaxation(const MapRelaxationOptions& options, const MetricFrameOptions& metric,
                const std::vector<SubmapId>& submaps, const MapModel& model,
                const std::vector<PositionTerm>* positions);
  ~MapRelaxation();

  // Goes on to its end, which is true, or until the interrupt; call it again then. The systems are
  // solved by another thread, which an interrupt does not wait for.
  bool Run(const MapModel& model, const std::atomic<bool>* interrupt);
  // `interrupted` and so on, so far.
  const RelaxationSummary& summary() const;
  // Moves the model as the complete steps moved the copy, once; the submaps that were relaxed are
  // still there, in the same world. Returns how the world about the end of each moved.
  std::map<SubmapId, Similarity3> ApplyTo(MapModel* model) const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

// All of it at once. Interrupted, it keeps the steps that were complete.
RelaxationSummary RelaxSubmaps(const MapRelaxationOptions& options,
                               const MetricFrameOptions& metric,
                               const std::vector<SubmapId>& submaps,
                               const std::atomic<bool>* interrupt, MapModel* model,
                               const std::vector<PositionTerm>* positions = nullptr);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_MAP_RELAXATION_H_
