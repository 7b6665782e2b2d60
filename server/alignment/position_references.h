// What is known about positions in one component, put in terms of the map: fixes of satellite
// receivers between keyframes, and control points that keyframes show.
#ifndef PORTOLAN_SERVER_ALIGNMENT_POSITION_REFERENCES_H_
#define PORTOLAN_SERVER_ALIGNMENT_POSITION_REFERENCES_H_

#include <string>
#include <vector>

#include "common/bundle/triangulation.h"
#include "server/alignment/map_model.h"
#include "server/georeference/georeference_fit.h"
#include "server/georeference/survey.h"

namespace portolan {

struct PositionReferenceOptions {
  // A map that drifts fits the sights of a pass to some pixels only.
  TriangulationOptions triangulation = {.inlier_chi2 = 400};
  // Fixes of one receiver nearer than this in time share their error: together they tell as much
  // as one.
  Duration fix_correlation = std::chrono::seconds(1);
  // A pass by a control point counts only if its rays meet at more than this angle.
  double min_pass_parallax_rad = 0.02;

  Status Validate() const;
};

// A place that moves with a submap, and where it should be.
struct PositionTerm {
  SubmapId submap;
  // Between which keyframes: 2.25 is a quarter of the way from the third to the fourth.
  double keyframe = 0;
  SitePoint point;  // in_world: as the map has it now
  // Of the survey's points; -1: a fix.
  int control_point = -1;
  Timestamp time{};
};

// A control point and the keyframes that show it.
struct SurveyedPoint {
  struct Sight {
    SubmapId submap;  // (submap, keyframe) is a MapModel::CameraOf()
    int keyframe = 0;
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
    double sigma_px = 1;
  };
  int index = 0;  // in the survey
  Eigen::Vector3d position_in_site = Eigen::Vector3d::Zero();
  double sigma_m = 0.02;
  std::vector<Sight> sights;
};

struct PositionReferences {
  std::vector<PositionTerm> terms;  // fixes by submap and time, then passes by control points
  std::vector<SurveyedPoint> points;
  // Positions that have no place in the site's frame, and why.
  int unusable = 0;
  std::string unusable_reason;
};

// The keyframe taken at that time (kKeyframeTimeTolerance); -1 if there is none.
int KeyframeAt(const Submap& submap, Timestamp time);

// Of these submaps (a component, ascending), all but quarantined ones. `metres_per_unit`: of the
// world, for the receivers' lever arms.
PositionReferences CollectPositionReferences(const PositionReferenceOptions& options,
                                             const MapModel& model,
                                             const std::vector<SubmapId>& submaps,
                                             const Survey& survey, const SiteOrigin& origin,
                                             double metres_per_unit);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_POSITION_REFERENCES_H_
