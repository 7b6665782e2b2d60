#include "common/concurrency/backoff.h"

#include "tests/support/matchers.h"

namespace portolan {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::HasSubstr;

BackoffOptions WithoutJitter() {
  BackoffOptions options;
  options.initial = milliseconds(100);
  options.max = seconds(1);
  options.jitter = 0;
  return options;
}

TEST(Backoff, GrowsToItsMaximum) {
  FakeClock clock;
  Backoff backoff(WithoutJitter(), 1, &clock);
  for (const int expected_ms : {100, 200, 400, 800, 1000, 1000}) {
    backoff.AttemptStarted();
    EXPECT_EQ(backoff.AttemptFailed(), milliseconds(expected_ms));
  }
  EXPECT_EQ(backoff.failures(), 6);
}

TEST(Backoff, CountsFromTheTimeOfTheFailure) {
  FakeClock clock;
  Backoff backoff(WithoutJitter(), 1, &clock);
  backoff.AttemptStarted();
  clock.Advance(seconds(2));
  EXPECT_EQ(backoff.AttemptFailed(), milliseconds(2100));
}

TEST(Backoff, StartsAfreshAfterALongAttemptAndAfterReset) {
  FakeClock clock;
  Backoff backoff(WithoutJitter(), 1, &clock);
  for (int i = 0; i < 5; ++i) backoff.AttemptFailed();
  backoff.AttemptStarted();
  clock.Advance(seconds(10));
  EXPECT_EQ(backoff.AttemptFailed() - clock.Now(), milliseconds(100));
  backoff.AttemptStarted();
  EXPECT_EQ(backoff.AttemptFailed() - clock.Now(), milliseconds(200));
  backoff.Reset();
  EXPECT_EQ(backoff.AttemptFailed() - clock.Now(), milliseconds(100));
}

TEST(Backoff, JitterStaysInItsRangeAndFollowsTheSeed) {
  FakeClock clock;
  BackoffOptions options = WithoutJitter();
  options.jitter = 0.5;
  Backoff a(options, 1, &clock), same(options, 1, &clock), other(options, 2, &clock);
  bool differs = false;
  for (int i = 0; i < 100; ++i) {
    for (Backoff* backoff : {&a, &same, &other}) backoff->Reset();
    const Duration wait = a.AttemptFailed();
    EXPECT_GE(wait, milliseconds(50));
    EXPECT_LE(wait, milliseconds(100));
    EXPECT_EQ(same.AttemptFailed(), wait);
    differs = differs || other.AttemptFailed() != wait;
  }
  EXPECT_TRUE(differs);
}

TEST(Backoff, SurvivesAnyNumberOfFailures) {
  FakeClock clock;
  Backoff backoff(WithoutJitter(), 1, &clock);
  for (int i = 0; i < 5000; ++i) EXPECT_LE(backoff.AttemptFailed(), seconds(1));
}

TEST(BackoffOptions, ValidateNamesTheField) {
  EXPECT_THAT(BackoffOptions().Validate(), IsOk());
  const auto refuses = [](const char* what, auto change) {
    BackoffOptions options;
    change(&options);
    EXPECT_THAT(options.Validate(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  refuses("initial", [](auto* o) { o->initial = Duration::zero(); });
  refuses("max", [](auto* o) { o->max = milliseconds(1); });
  refuses("factor", [](auto* o) { o->factor = 0.9; });
  refuses("jitter", [](auto* o) { o->jitter = 1.0; });
  refuses("success_after", [](auto* o) { o->success_after = Duration(-1); });
}

}  // namespace
}  // namespace portolan
