#include "server/evaluation/evaluate_command.h"

#include <filesystem>
#include <sstream>
#include <vector>

#include "common/trajectory/trajectory_io.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

using testing::AllOf;
using testing::HasSubstr;

struct Outcome {
  int code;
  std::string output, errors;
};

Outcome Evaluate(const std::vector<std::string>& args) {
  std::ostringstream output, errors;
  const int code = RunEvaluate(args, output, errors);
  return {code, output.str(), errors.str()};
}

// A spiral at 20 Hz, scaled by `scale`.
Trajectory Spiral(double scale, int first, int last) {
  Trajectory trajectory;
  for (int i = first; i < last; ++i) {
    const double angle = 0.1 * i;
    trajectory.push_back({std::chrono::milliseconds(50 * i),
                          {RotationExp({0, 0, angle}),
                           scale * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0.02 * i)}});
  }
  return trajectory;
}

class EvaluateCommand : public testing::Test {
 protected:
  std::string Write(const std::string& name, const Trajectory& trajectory) {
    const std::string path = (dir_ / name).string();
    EXPECT_THAT(WriteTumTrajectory(trajectory, path), IsOk());
    return path;
  }

  TempDir dir_;
};

TEST_F(EvaluateCommand, PrintsTheTable) {
  const std::string truth = Write("gt.txt", Spiral(1, 0, 100));
  const std::string estimate = Write("a.tum", Spiral(0.5, 0, 100));
  const Outcome outcome = Evaluate({"--estimate", estimate, "--groundtruth", truth});
  EXPECT_EQ(outcome.code, 0) << outcome.errors;
  EXPECT_THAT(outcome.output, AllOf(HasSubstr("alignment sim3"), HasSubstr("-50.000")));
}

TEST_F(EvaluateCommand, PrintsJsonForSeveralAgents) {
  const std::string truth = Write("gt.txt", Spiral(1, 0, 100));
  const std::string first = Write("a.tum", Spiral(1.1, 0, 50));
  const std::string second = Write("b.tum", Spiral(1.1, 50, 100));
  const Outcome outcome = Evaluate({"--estimate", first, "--estimate", second, "--groundtruth",
                                    truth, "--align", "se3", "--json", "--name", "left"});
  EXPECT_EQ(outcome.code, 0) << outcome.errors;
  EXPECT_THAT(outcome.output,
              AllOf(HasSubstr(R"("alignment": "se3")"), HasSubstr(R"("name": "left")"),
                    HasSubstr(R"("name": "b.tum")"),
                    HasSubstr(R"("joint": {"poses": 100, "matched": 100, "coverage": 1,)"),
                    testing::ContainsRegex("\"scale_error\": 0[.](1|0999999)")));
}

TEST_F(EvaluateCommand, FilesOfOneNameAreToldApartByTheirFolders) {
  const std::string truth = Write("gt.txt", Spiral(1, 0, 100));
  std::filesystem::create_directory(dir_ / "a");
  std::filesystem::create_directory(dir_ / "b");
  const std::string first = Write("a/live.tum", Spiral(1.1, 0, 50));
  const std::string second = Write("b/live.tum", Spiral(1.1, 50, 100));
  const Outcome outcome =
      Evaluate({"--estimate", first, "--estimate", second, "--groundtruth", truth});
  EXPECT_EQ(outcome.code, 0) << outcome.errors;
  EXPECT_THAT(outcome.output, AllOf(HasSubstr("a/live.tum"), HasSubstr("b/live.tum")));
}

TEST_F(EvaluateCommand, StampsSetWhatCoverageCounts) {
  Trajectory dense;  // ground truth at 200 Hz: an estimate at 20 Hz is near only some stamps
  for (int i = 0; i < 400; ++i) {
    dense.push_back({std::chrono::milliseconds(5 * i),
                     {Eigen::Quaterniond::Identity(), {0.01 * i, 0.001 * i * i, 0}}});
  }
  Trajectory estimate;
  std::string times;
  for (size_t i = 0; i < dense.size(); i += 10) {
    estimate.push_back(dense[i]);
    times += FormatSeconds(dense[i].time) + " image\n";
  }
  const std::string truth = Write("gt.txt", dense), sparse = Write("a.tum", estimate);
  const std::string stamps = dir_.Write("times.txt", times).string();
  const Outcome all = Evaluate({"--estimate", sparse, "--groundtruth", truth, "--json"});
  EXPECT_THAT(all.output, HasSubstr(R"("coverage": 0.89,)"));
  const Outcome images =
      Evaluate({"--estimate", sparse, "--groundtruth", truth, "--json", "--stamps", stamps});
  EXPECT_THAT(images.output, HasSubstr(R"("coverage": 1,)"));
}

TEST_F(EvaluateCommand, MovesTheBodysTruthToTheCamera) {
  const Trajectory body = Spiral(1, 0, 100);
  Trajectory camera = body;
  const Rigid3 body_from_camera{RotationExp({0, 0, M_PI / 2}), {0.5, 0, 0}};
  for (StampedPose& pose : camera) pose.world_from_body = pose.world_from_body * body_from_camera;
  const std::string truth = Write("gt.txt", body), estimate = Write("a.tum", camera);
  const std::string yaml =
      dir_.Write("sensor.yaml",
                 "sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n"
                 "  data: [0, -1, 0, 0.5, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
                 "rate_hz: 20\nresolution: [752, 480]\ncamera_model: pinhole\n"
                 "intrinsics: [458, 457, 367, 248]\ndistortion_model: radial-tangential\n"
                 "distortion_coefficients: [0, 0, 0, 0]\n")
          .string();
  const Outcome outcome = Evaluate({"--estimate", estimate, "--groundtruth", truth, "--align",
                                    "none", "--camera", yaml, "--json"});
  EXPECT_EQ(outcome.code, 0) << outcome.errors;
  EXPECT_THAT(outcome.output, testing::ContainsRegex("\"ate_m\": [^}]*\"rmse\": [0-9.]+e-"));
}

TEST_F(EvaluateCommand, WritesThePlot) {
  const std::string truth = Write("gt.txt", Spiral(1, 0, 100));
  const std::string plot = (dir_ / "plot.png").string();
  EXPECT_EQ(Evaluate({"--estimate", truth, "--groundtruth", truth, "--plot", plot}).code, 0);
  EXPECT_GT(std::filesystem::file_size(plot), 10000u);
}

TEST_F(EvaluateCommand, ReportsBadFiles) {
  const std::string truth = Write("gt.txt", Spiral(1, 0, 100));
  const std::string bad = dir_.Write("bad.tum", "1 2 3\n").string();
  const Outcome broken = Evaluate({"--estimate", bad, "--groundtruth", truth});
  EXPECT_EQ(broken.code, 1);
  EXPECT_THAT(broken.errors, HasSubstr("bad.tum:1: expected 8 fields, found 3"));
  EXPECT_EQ(Evaluate({"--estimate", "missing.tum", "--groundtruth", truth}).code, 1);
  const std::string empty = dir_.Write("empty.txt", "").string();
  EXPECT_EQ(Evaluate({"--estimate", truth, "--groundtruth", empty}).code, 1);
  const Outcome apart =
      Evaluate({"--estimate", Write("b.tum", Spiral(1, 200, 300)), "--groundtruth", truth});
  EXPECT_EQ(apart.code, 1);
  EXPECT_THAT(apart.errors, HasSubstr("only 0 poses match"));
}

TEST_F(EvaluateCommand, ReportsBadCommandLines) {
  EXPECT_EQ(Evaluate({}).code, 2);
  EXPECT_EQ(Evaluate({"--estimate", "a"}).code, 2);
  EXPECT_EQ(Evaluate({"--estimate"}).code, 2);
  EXPECT_EQ(Evaluate({"--estimate", "a", "--groundtruth", "b", "--align", "affine"}).code, 2);
  EXPECT_EQ(Evaluate({"--estimate", "a", "--groundtruth", "b", "--rpe-time", "-1"}).code, 2);
  EXPECT_EQ(Evaluate({"--estimate", "a", "--groundtruth", "b", "--groundtruth", "c"}).code, 2);
  EXPECT_THAT(Evaluate({"--frob", "1"}).errors, HasSubstr("unknown option --frob"));
  const Outcome help = Evaluate({"--help"});
  EXPECT_EQ(help.code, 0);
  EXPECT_THAT(help.output, HasSubstr("Usage: portolan evaluate"));
}

}  // namespace
}  // namespace portolan
