// The bundle problem of a window of the map: built from the model, and written back.
#ifndef PORTOLAN_SERVER_ALIGNMENT_WINDOW_PROBLEM_H_
#define PORTOLAN_SERVER_ALIGNMENT_WINDOW_PROBLEM_H_

#include <cstdint>
#include <optional>
#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include "common/bundle/bundle_problem.h"
#include "server/alignment/map_adjuster.h"

namespace portolan {

// See AdjustMap. The options, the model and the positions (null for none) must outlive it.
class WindowProblem {
 public:
  WindowProblem(const MapAdjusterOptions& options, const std::vector<SubmapId>& window,
                MapModel* model, const PositionReferences* positions);

  BundleProblem& problem() { return problem_; }
  // What the problem consists of, without control points; no summary.
  MapAdjustment contents() const;
  // Landmarks with fewer than two inliers.
  void Retriangulate();
  // All landmarks, from all their observations and the cameras as they are: what was an outlier
  // before has the same say as any other.
  void TriangulateAnew();
  // In the unit of the world that there was.
  void WriteBack();

 private:
  struct SightName {
    SubmapId submap;
    int landmark = 0;
    int sight = 0;
  };

  void AddLandmarks();
  void AddLandmark(int index);
  int CameraIndex(SubmapId id, int keyframe);
  // A keyframe shared with a held neighbour moves with the window.
  bool IsFree(const std::pair<SubmapId, int>& camera) const;
  void FixGauge();
  void KeepUnitOfWorld();
  // A held keyframe, but for the one that holds the world, was placed by the lens as it is.
  void AddLenses();
  // Every metric submap says how far apart its first keyframe and the one farthest from it are:
  // what they are now, times the factor that its filter's landmarks ask for.
  void AddMetricDistances();
  // Each fix pulls at the camera nearest in time, which is as far from the antenna as it is now.
  void AddFixes();
  // The keyframe nearest to a place between two, of those that are adjusted.
  int Essential(SubmapId id, double keyframe) const;
  // The pixel in which the essential keyframe would see what a redundant one, which hangs on it,
  // sees in its own: the place on the ray that is as far away as the point. No value if it would
  // not.
  std::optional<Eigen::Vector2d> PixelIn(int essential, const SurveyedPoint::Sight& sight,
                                         const Eigen::Vector3d& point_in_world) const;
  // Its own error counts as one of the pixels; all observations share it.
  void AddSurveyedPoint(const SurveyedPoint& surveyed);
  // Median distance of a submap's landmarks, in the world's units.
  double SceneDepth(SubmapId id) const;
  // Calls function(first, end) for the observations of every landmark.
  template <typename Function>
  void ForEachLandmark(const Function& function) const;
  void TriangulatePoint(const TriangulationOptions& options, size_t begin, size_t end,
                        double scene_depth);

  const MapAdjusterOptions& options_;
  const std::set<SubmapId> window_;
  MapModel& model_;
  const PositionReferences* const positions_;
  BundleProblem problem_;
  // Parallel to the observations and to the points; those of control points follow.
  std::vector<SightName> names_;
  std::vector<int> point_landmarks_;
  std::vector<std::pair<SubmapId, int>> camera_names_;
  // Parallel to the lenses: a submap of the session.
  std::vector<SubmapId> lens_names_;
  std::unordered_map<uint64_t, int> cameras_;
  // The camera that holds the world, if nothing holds the unit.
  std::optional<int> origin_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_WINDOW_PROBLEM_H_
