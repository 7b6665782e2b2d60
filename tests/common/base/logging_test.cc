#include "common/base/logging.h"

#include <string>
#include <thread>
#include <vector>

#include "tests/support/matchers.h"

namespace portolan {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class LoggingTest : public testing::Test {
 protected:
  LoggingTest() {
    SetLogSink([this](LogLevel, std::string_view text) { lines_.emplace_back(text); });
  }
  ~LoggingTest() override {
    SetLogSink({});
    SetLogLevel(LogLevel::kInfo);
  }
  std::vector<std::string> lines_;
};

TEST_F(LoggingTest, JoinsItsArguments) {
  LogWarning("frame ", 3, " at ", 1.5, " s");
  EXPECT_THAT(lines_, ElementsAre("frame 3 at 1.5 s"));
}

TEST_F(LoggingTest, DropsLinesBelowTheLevel) {
  LogDebug("a");
  LogInfo("b");
  SetLogLevel(LogLevel::kError);
  LogWarning("c");
  LogError("d");
  SetLogLevel(LogLevel::kNone);
  LogError("e");
  EXPECT_THAT(lines_, ElementsAre("b", "d"));
}

TEST_F(LoggingTest, ManyThreadsLoseNoLine) {
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([] {
      for (int i = 0; i < 250; ++i) LogInfo("line ", i);
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(lines_.size(), 1000u);
}

TEST(Logging, WritesLevelAndTextToStandardError) {
  testing::internal::CaptureStderr();
  LogWarning("careful");
  const std::string output = testing::internal::GetCapturedStderr();
  EXPECT_THAT(output, testing::StartsWith("W "));
  EXPECT_THAT(output, testing::EndsWith(" careful\n"));
}

TEST(Logging, ParsesLevelNames) {
  EXPECT_EQ(ParseLogLevel("warning").value(), LogLevel::kWarning);
  EXPECT_THAT(ParseLogLevel("loud"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("'loud'")));
}

}  // namespace
}  // namespace portolan
