// A trajectory evaluation as a table for people, as JSON for programs, and as a picture.
#ifndef PORTOLAN_SERVER_EVALUATION_EVALUATION_REPORT_H_
#define PORTOLAN_SERVER_EVALUATION_EVALUATION_REPORT_H_

#include <span>
#include <string>

#include "common/trajectory/evaluation.h"
#include "server/evaluation/map_plot.h"

namespace portolan {

std::string EvaluationText(const TrajectoryEvaluation& evaluation);

// One object: alignment, joint (errors of all agents), agents (name, joint_alignment,
// own_alignment or null). Lengths in metres, angles in degrees, coverage and scale as shares.
std::string EvaluationJson(const TrajectoryEvaluation& evaluation);

// The estimates under the joint alignment against the references of the same evaluation.
MapPlot EvaluationPlot(const TrajectoryEvaluation& evaluation,
                       std::span<const TrajectoryPair> agents);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_EVALUATION_EVALUATION_REPORT_H_
