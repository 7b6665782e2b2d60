#include "server/evaluation/evaluation_report.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace portolan {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

Trajectory Zigzag(int poses) {
  Trajectory trajectory;
  for (int i = 0; i < poses; ++i) {
    trajectory.push_back(
        {std::chrono::milliseconds(50 * i),
         {Eigen::Quaterniond::Identity(), {0.1 * i, 0.3 * (i % 5), 0.2 * (i % 3)}}});
  }
  return trajectory;
}

TrajectoryEvaluation EvaluateTwo(const std::string& name, Trajectory* truth, Trajectory* lost) {
  const TrajectoryPair agents[] = {{name, truth, truth}, {"lost", lost, truth}};
  return *EvaluateTrajectories(agents, EvaluationOptions());
}

TEST(EvaluationText, LabelsJointAndOwnAlignments) {
  Trajectory truth = Zigzag(50), lost;
  EXPECT_THAT(EvaluationText(EvaluateTwo("first", &truth, &lost)),
              AllOf(HasSubstr("alignment sim3"), HasSubstr("one joint alignment"),
                    HasSubstr("each agent aligned alone"), HasSubstr("first"),
                    HasSubstr("lost: too few matched poses")));
}

TEST(EvaluationText, IsShortForOneAgent) {
  Trajectory truth = Zigzag(50);
  const TrajectoryPair agent{"only", &truth, &truth};
  EXPECT_THAT(EvaluationText(*EvaluateTrajectories({&agent, 1}, EvaluationOptions())),
              Not(HasSubstr("alone")));
}

TEST(EvaluationJson, EscapesNamesAndWritesNulls) {
  Trajectory truth = Zigzag(50), lost;
  const std::string json = EvaluationJson(EvaluateTwo("a\"b\\c\n", &truth, &lost));
  EXPECT_THAT(json,
              AllOf(HasSubstr(R"("name": "a\"b\\c\u000a")"), HasSubstr(R"("own_alignment": null)"),
                    HasSubstr(R"("scale_error": null)"), HasSubstr(R"("alignment": "sim3")"),
                    HasSubstr(R"("coverage": 1,)")));
}

TEST(EvaluationPlot, DrawsASharedReferenceOnce) {
  Trajectory truth = Zigzag(50), lost;
  const TrajectoryPair agents[] = {{"a", &truth, &truth}, {"lost", &lost, &truth}};
  const MapPlot plot = EvaluationPlot(EvaluateTwo("a", &truth, &lost), agents);
  EXPECT_EQ(plot.references.size(), 1u);
  ASSERT_EQ(plot.trajectories.size(), 2u);
  EXPECT_EQ(plot.trajectories[0].positions.size(), 50u);
  EXPECT_EQ(plot.trajectories[0].errors.size(), 50u);
  EXPECT_TRUE(plot.trajectories[1].positions.empty());
}

}  // namespace
}  // namespace portolan
