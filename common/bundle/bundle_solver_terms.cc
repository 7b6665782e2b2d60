#include "common/bundle/bundle_solver_terms.h"

namespace portolan::bundle_solver {
namespace {

void SetLens(const BundleProblem& problem, const BundleObservation& observation, Term* term) {
  const BundleCamera& camera = problem.cameras[observation.camera];
  if (camera.lens < 0) return;
  term->lens = camera.lens;
  term->lens_slope << camera.model->DPixelDRadial(camera.world_from_camera.Inverse() *
                                                  problem.points[observation.point].point_in_world),
      -observation.row_motion;
  term->lens_slope /= observation.sigma_px;
}

}  // namespace

void CollectTerms(const BundleOptions& options, const BundleProblem& problem,
                  const BundleParameters& parameters, const std::vector<int>& place_of,
                  std::vector<Term>* terms, std::vector<PointTerms>* points) {
  // The observations sorted by point.
  std::vector<size_t> begin_of(problem.points.size() + 1, 0);
  for (const BundleObservation& observation : problem.observations) {
    if (parameters.HasSay(problem, observation)) ++begin_of[observation.point + 1];
  }
  for (size_t i = 1; i < begin_of.size(); ++i) begin_of[i] += begin_of[i - 1];
  std::vector<int> order(begin_of.back());
  std::vector<size_t> next(begin_of.begin(), begin_of.end() - 1);
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    const BundleObservation& observation = problem.observations[i];
    if (!parameters.HasSay(problem, observation)) continue;
    order[next[observation.point]++] = static_cast<int>(i);
  }
  terms->reserve(order.size());
  for (const int i : order) {
    const BundleObservation& observation = problem.observations[i];
    terms->push_back({observation.camera, place_of[observation.camera],
                      ReprojectionError(&parameters.point_references[observation.point],
                                        observation.pixel, observation.sigma_px)});
    SetLens(problem, observation, &terms->back());
  }
  for (size_t point = 0; point < problem.points.size(); ++point) {
    if (begin_of[point] == begin_of[point + 1]) continue;
    PointTerms of_point;
    of_point.point = static_cast<int>(point);
    of_point.begin = begin_of[point];
    of_point.end = begin_of[point + 1];
    of_point.is_free = parameters.IsAdjusted(problem, point);
    of_point.rho = parameters.points[point][2];
    of_point.inverse_sigma = 1 / parameters.InverseDepthSigma(options, point);
    points->push_back(of_point);
  }
}

}  // namespace portolan::bundle_solver
