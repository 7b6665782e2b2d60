#include "agent/image_source/text_lines.h"

#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

using absl::StatusCode;
using testing::ElementsAre;
using testing::HasSubstr;

TEST(ParseSeconds, KeepsEveryNanosecond) {
  EXPECT_EQ(ParseSeconds("1305031102.175304")->count(), 1305031102175304000);
  EXPECT_EQ(ParseSeconds("1403636584.763555584")->count(), 1403636584763555584);
  EXPECT_EQ(ParseSeconds("0")->count(), 0);
  EXPECT_EQ(ParseSeconds("12.")->count(), 12000000000);
  EXPECT_EQ(ParseSeconds("1.0123456789")->count(), 1012345678);
  EXPECT_EQ(ParseSeconds("1.037875e-01")->count(), 103787500);
  EXPECT_EQ(ParseSeconds("-0.5")->count(), -500000000);
}

TEST(ParseSeconds, RefusesWhatIsNoTime) {
  for (const char* text : {"", "x", "1.2.3", "nan", "1e30", "99999999999", "1.5s"}) {
    EXPECT_FALSE(ParseSeconds(text).ok()) << text;
  }
}

TEST(ParseNanoseconds, RefusesWhatDoesNotFit) {
  EXPECT_EQ(ParseNanoseconds("1403636584763555584")->count(), 1403636584763555584);
  EXPECT_FALSE(ParseNanoseconds("14036365847635555840").ok());
  EXPECT_FALSE(ParseNanoseconds("1.5").ok());
}

TEST(ForEachLine, SkipsCommentsAndSplitsByCommaOrBlank) {
  const TempDir dir;
  const auto path = dir.Write("t", "#h\n\n 1 two\t3 \r\n4, five ,6,\r\n7,,8");
  std::vector<std::vector<std::string>> lines;
  ASSERT_THAT(ForEachLine(path,
                          [&](const std::vector<std::string>& fields) {
                            lines.push_back(fields);
                            return absl::OkStatus();
                          }),
              IsOk());
  EXPECT_THAT(lines, ElementsAre(ElementsAre("1", "two", "3"), ElementsAre("4", "five", "6"),
                                 ElementsAre("7", "", "8")));
}

TEST(ForEachLine, ErrorNamesFileAndLine) {
  const TempDir dir;
  const auto path = dir.Write("list.csv", "#h\na\nb\n");
  const Status status = ForEachLine(path, [](const std::vector<std::string>& fields) {
    return fields[0] == "b" ? absl::InvalidArgumentError("bad") : absl::OkStatus();
  });
  EXPECT_THAT(status, StatusIs(StatusCode::kInvalidArgument, HasSubstr("list.csv:3: bad")));
  EXPECT_THAT(ForEachLine(dir / "none", nullptr), StatusIs(StatusCode::kNotFound));
}

}  // namespace
}  // namespace portolan
