#include "common/config/yaml_file.h"

#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

using absl::StatusCode;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

TEST(YamlFile, MissingFileIsNotFound) {
  const TempDir dir;
  EXPECT_THAT(YamlFile::Load(dir / "none.yaml"), StatusIs(StatusCode::kNotFound));
  EXPECT_THAT(YamlFile::Load(dir.path()), StatusIs(StatusCode::kNotFound, HasSubstr("folder")));
}

TEST(YamlFile, SyntaxErrorNamesFileAndLine) {
  const TempDir dir;
  const auto path = dir.Write("bad.yaml", "a: 1\nb: [1, 2\nc: 3\n");
  EXPECT_THAT(YamlFile::Load(path), StatusIs(StatusCode::kInvalidArgument, HasSubstr("bad.yaml:")));
}

TEST(YamlFile, ReadsNumbersTextAndMatrices) {
  const auto file = YamlFile::Parse("a: 1.5\nb: 7\nc: word\nd: [[1, 2], [3, 4]]\n", "t").value();
  EXPECT_EQ(file.Number(file.root(), "a").value(), 1.5);
  EXPECT_EQ(file.Integer(file.root(), "b").value(), 7);
  EXPECT_EQ(file.Text(file.root(), "c").value(), "word");
  EXPECT_THAT(file.Numbers(file.root(), "d").value(), ElementsAre(1, 2, 3, 4));
}

TEST(YamlFile, ErrorsNameLineAndKey) {
  const auto file = YamlFile::Parse("a: x\nb: .inf\nc: 1.5\nd: [1, two]\ne: {f: 1}\n", "t").value();
  const auto& root = file.root();
  const auto code = StatusCode::kInvalidArgument;
  EXPECT_THAT(file.Number(root, "a"), StatusIs(code, AllOf(HasSubstr("t:1:"), HasSubstr("a:"))));
  EXPECT_THAT(file.Number(root, "b"), StatusIs(code, HasSubstr("t:2: b")));
  EXPECT_THAT(file.Integer(root, "c"), StatusIs(code, HasSubstr("t:3: c")));
  EXPECT_THAT(file.Numbers(root, "d"), StatusIs(code, HasSubstr("t:4: d: entry 1")));
  EXPECT_THAT(file.Text(root, "e"), StatusIs(code, HasSubstr("t:5: e")));
  EXPECT_THAT(file.Number(root, "gone"), StatusIs(code, HasSubstr("'gone' is missing")));
}

TEST(YamlFile, AcceptsTheHeaderOfOpenCv) {
  const auto file = YamlFile::Parse("%YAML:1.0\n---\na: !!opencv-matrix\n   rows: 2\n", "t");
  ASSERT_THAT(file, IsOk());
  EXPECT_EQ(file->Integer(file->Child(file->root(), "a").value(), "rows").value(), 2);
}

TEST(YamlFile, DeepNestingAndEmptyTextAreNoCrash) {
  EXPECT_FALSE(YamlFile::Parse(std::string(100000, '['), "t").ok());
  std::string deep;
  for (int i = 0; i < 100000; ++i) deep += "- ";
  EXPECT_FALSE(YamlFile::Parse(deep, "t").ok());
  const auto empty = YamlFile::Parse("", "t");
  ASSERT_THAT(empty, IsOk());
  EXPECT_FALSE(empty->Number(empty->root(), "a").ok());
}

}  // namespace
}  // namespace portolan
