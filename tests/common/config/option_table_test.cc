#include "common/config/option_table.h"

#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

using absl::StatusCode;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

enum class Detector { kHarris, kFast };

class OptionTableTest : public testing::Test {
 protected:
  OptionTableTest() {
    table_.Add("server", &server_, "", "Address of the server.");
    OptionSection tracker = table_.Section("tracker");
    tracker.Add("max_points", &max_points_, "points", "More cost time.");
    tracker.Add("use_gate", &use_gate_, "", "Gate matches.");
    tracker.AddChoice("detector", &detector_,
                      {{"harris", Detector::kHarris}, {"fast", Detector::kFast}},
                      "Corner detector.");
    table_.Add("filter.sigma", &sigma_, "px", "Noise of a corner.");
    tracker.Section("lk").Add("levels", &levels_, "", "Pyramid levels.");
    table_.Add("end", &end_, "frames", "Last frame.");
    table_.Add("files", &files_, "", "Input files.");
    table_.Alias("n", "tracker.max_points");
  }

  StatusOr<CommandLine> Parse(std::vector<const char*> words) {
    words.insert(words.begin(), "program");
    return table_.ParseCommandLine(static_cast<int>(words.size()), words.data());
  }
  Status ApplyYaml(std::string_view text) {
    return table_.ApplyYaml(YamlFile::Parse(text, "t.yaml").value());
  }

  std::string server_ = "localhost:7000";
  int max_points_ = 150, levels_ = 3;
  bool use_gate_ = false;
  Detector detector_ = Detector::kHarris;
  double sigma_ = 0.5;
  std::optional<double> end_;
  std::vector<std::string> files_;
  OptionTable table_;
};

TEST_F(OptionTableTest, YamlSetsNestedKeysAndLeavesTheOthers) {
  ASSERT_THAT(ApplyYaml("tracker:\n  max_points: 200\n  detector: fast\n  lk: {levels: 4}\n"
                        "end: 12.5\nfiles: [a b, c]\nfilter:\n"),
              IsOk());
  EXPECT_EQ(max_points_, 200);
  EXPECT_EQ(detector_, Detector::kFast);
  EXPECT_EQ(levels_, 4);
  EXPECT_EQ(end_, 12.5);
  EXPECT_THAT(files_, ElementsAre("a b", "c"));
  EXPECT_EQ(sigma_, 0.5);
}

TEST_F(OptionTableTest, UnknownKeyNamesFileLineAndTheNearestName) {
  EXPECT_THAT(ApplyYaml("server: x\ntracker:\n  max_pionts: 200\n"),
              StatusIs(StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("t.yaml:3:"), HasSubstr("'tracker.max_pionts'"),
                             HasSubstr("did you mean 'tracker.max_points'"))));
}

TEST_F(OptionTableTest, WrongTypesNameFileLineAndKey) {
  const auto code = StatusCode::kInvalidArgument;
  EXPECT_THAT(ApplyYaml("tracker: {max_points: many}"),
              StatusIs(code, HasSubstr("t.yaml:1: tracker.max_points: expected a whole number")));
  EXPECT_THAT(ApplyYaml("server: [a, b]"), StatusIs(code, HasSubstr("server: expected a single")));
  EXPECT_THAT(ApplyYaml("server:"), StatusIs(code, HasSubstr("server: expected a single")));
  EXPECT_THAT(ApplyYaml("files: a"), StatusIs(code, HasSubstr("files: expected a list")));
  EXPECT_THAT(ApplyYaml("tracker: 5"), StatusIs(code, HasSubstr("tracker: expected a section")));
  EXPECT_THAT(ApplyYaml("tracker: {detector: sift}"), StatusIs(code, HasSubstr("harris, fast")));
  EXPECT_THAT(ApplyYaml("- 1"), StatusIs(code, HasSubstr("t.yaml:1:")));
}

TEST_F(OptionTableTest, RepeatedKeyIsAnError) {
  EXPECT_THAT(ApplyYaml("server: a\nserver: b\n"),
              StatusIs(StatusCode::kInvalidArgument, HasSubstr("t.yaml:2: server: given twice")));
}

TEST_F(OptionTableTest, FlagsTakeBothForms) {
  const auto line = Parse({"in", "--tracker.max_points", "7", "--filter.sigma=-0.25",
                           "--tracker.use-gate", "--files=a,b", "out"});
  ASSERT_THAT(line, IsOk());
  EXPECT_THAT(line->positional, ElementsAre("in", "out"));
  EXPECT_EQ(max_points_, 7);
  EXPECT_EQ(sigma_, -0.25);
  EXPECT_TRUE(use_gate_);
  EXPECT_THAT(files_, ElementsAre("a", "b"));
}

TEST_F(OptionTableTest, BoolFlagsNeverTakeTheNextWord) {
  const auto line = Parse({"--tracker.use_gate", "folder", "--n", "3"});
  ASSERT_THAT(line, IsOk());
  EXPECT_THAT(line->positional, ElementsAre("folder"));
  EXPECT_EQ(max_points_, 3);
  ASSERT_THAT(Parse({"--no-tracker.use_gate"}), IsOk());
  EXPECT_FALSE(use_gate_);
  ASSERT_THAT(Parse({"--tracker.use_gate=true"}), IsOk());
  EXPECT_TRUE(use_gate_);
}

TEST_F(OptionTableTest, FlagsWinOverTheFileWhateverTheOrder) {
  const TempDir dir;
  const auto path = dir.Write("a.yaml", "server: file\ntracker: {max_points: 11}\n").string();
  ASSERT_THAT(Parse({"--server", "flag", "--config", path.c_str()}), IsOk());
  EXPECT_EQ(server_, "flag");
  EXPECT_EQ(max_points_, 11);
}

TEST_F(OptionTableTest, EmptyValuesAndNone) {
  end_ = 3;
  ASSERT_THAT(Parse({"--end", "none", "--server=", "--files="}), IsOk());
  EXPECT_FALSE(end_);
  EXPECT_EQ(server_, "");
  EXPECT_THAT(files_, IsEmpty());
}

TEST_F(OptionTableTest, BadFlagsAreNamed) {
  const auto code = StatusCode::kInvalidArgument;
  EXPECT_THAT(Parse({"--tracker.max_point=3"}),
              StatusIs(code, HasSubstr("did you mean 'tracker.max_points'")));
  EXPECT_THAT(Parse({"--server"}), StatusIs(code, HasSubstr("--server needs a value")));
  EXPECT_THAT(Parse({"--n", "x"}), StatusIs(code, HasSubstr("--n: expected a whole number")));
  EXPECT_THAT(Parse({"--no-server"}), StatusIs(code, HasSubstr("unknown option")));
  EXPECT_THAT(Parse({"--no-tracker.use_gate=true"}), StatusIs(code, HasSubstr("no value")));
  EXPECT_THAT(Parse({"--config", "/no/such/file"}), StatusIs(StatusCode::kNotFound));
}

TEST_F(OptionTableTest, DoubleDashEndsTheFlags) {
  const auto line = Parse({"--", "--server", "x"});
  ASSERT_THAT(line, IsOk());
  EXPECT_THAT(line->positional, ElementsAre("--server", "x"));
}

TEST_F(OptionTableTest, HelpIsAskedForAndListsEveryOption) {
  EXPECT_TRUE(Parse({"-h"})->help);
  EXPECT_TRUE(Parse({"x", "--help"})->help);
  const std::string help = table_.Help("usage: program");
  for (const char* part : {"usage: program", "--config FILE", "--server  (default localhost:7000)",
                           "--tracker.max_points, --n  (default 150 points)", "More cost time.",
                           "One of: harris, fast", "--filter.sigma  (default 0.5 px)",
                           "--end  (default none frames)"}) {
    EXPECT_THAT(help, HasSubstr(part));
  }
}

TEST_F(OptionTableTest, WrittenYamlReadsBackAsTheSameValues) {
  ASSERT_THAT(Parse({"--files=a: b,c\"d", "--n=5", "--server=", "--tracker.detector=fast"}),
              IsOk());
  const std::string yaml = table_.ToYaml();
  files_.clear();
  max_points_ = 0;
  server_ = "x";
  detector_ = Detector::kHarris;
  ASSERT_THAT(ApplyYaml(yaml), IsOk()) << yaml;
  EXPECT_THAT(files_, ElementsAre("a: b", "c\"d"));
  EXPECT_EQ(max_points_, 5);
  EXPECT_EQ(server_, "");
  EXPECT_EQ(detector_, Detector::kFast);
  EXPECT_THAT(yaml, HasSubstr("    # Pyramid levels.\n    levels: 3\n"));
}

}  // namespace
}  // namespace portolan
