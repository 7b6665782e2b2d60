#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/repository/repository_rules.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr size_t kMostLines = 450;

// The tests run in the source root.
const std::vector<SourceFile>& ThisTree() {
  static const auto* files = new std::vector<SourceFile>(ReadTree("."));
  return *files;
}

SourceFile Includes(const std::string& path, const std::vector<std::string>& included) {
  SourceFile file{path, {}};
  for (const std::string& name : included) file.lines.push_back("#include \"" + name + "\"");
  return file;
}

TEST(ThisRepository, IsRead) {
  EXPECT_GT(ThisTree().size(), 50u);
  EXPECT_EQ(ThisTree().front().path.find("./"), std::string::npos);
}

TEST(ThisRepository, IncludesPointDownwards) {
  EXPECT_THAT(FindWrongLayers(ThisTree()), IsEmpty());
}

TEST(ThisRepository, IncludesFollowTheFlow) {
  EXPECT_THAT(FindUpstreamIncludes(ThisTree()), IsEmpty());
}

TEST(ThisRepository, FoldersDoNotIncludeEachOther) {
  EXPECT_THAT(FindFolderCycles(ThisTree()), IsEmpty());
}

TEST(ThisRepository, AlgorithmsArePure) {
  EXPECT_THAT(FindImpureAlgorithms(ThisTree()), IsEmpty());
}

TEST(ThisRepository, FilesAreShort) {
  EXPECT_THAT(FindLongFiles(ThisTree(), kMostLines), IsEmpty());
}

TEST(ThisRepository, HeadersHaveGuards) { EXPECT_THAT(FindWrongGuards(ThisTree()), IsEmpty()); }

TEST(ThisRepository, SourcesAreListed) { EXPECT_THAT(FindUnlistedSources(ThisTree()), IsEmpty()); }

TEST(ThisRepository, HoldsNoMachinePaths) { EXPECT_THAT(FindMachinePaths(ThisTree()), IsEmpty()); }

TEST(FindWrongLayers, FindsEveryWrongEdge) {
  EXPECT_THAT(FindWrongLayers({Includes("agent/a.cc", {"vector", "server/b.h"}),
                               Includes("server/b.cc", {"agent/a.h"}),
                               Includes("common/c/c.cc", {"agent/a.h"}),
                               Includes("common/d/d.cc", {"proto/x.pb.h", "common/c/c.h"}),
                               Includes("server/e.h", {"tests/support/x.h"})}),
              ElementsAre("agent/a.cc:2: agent must not include server",
                          "server/b.cc:1: server must not include agent",
                          "common/c/c.cc:1: common must not include agent",
                          "server/e.h:1: server must not include tests"));
}

TEST(FindWrongLayers, ReadsOddlyWrittenIncludes) {
  const SourceFile file{"agent/a.cc", {"  #  include   \"server/b.h\"  // why not"}};
  EXPECT_THAT(FindWrongLayers({file}), ElementsAre(HasSubstr("agent/a.cc:1:")));
  const SourceFile comment{"agent/a.cc", {"// #include \"server/b.h\"", "#include"}};
  EXPECT_THAT(FindWrongLayers({comment}), IsEmpty());
}

TEST(FindUpstreamIncludes, FindsAStageThatKnowsTheNext) {
  EXPECT_THAT(FindUpstreamIncludes({Includes("agent/tracker/t.h", {"agent/filter/f.h"}),
                                    Includes("agent/filter/f.cc", {"agent/tracker/t.h"})}),
              ElementsAre("agent/tracker/t.h:1: agent/tracker comes before agent/filter in the "
                          "flow"));
}

TEST(FindFolderCycles, FindsCircles) {
  const SourceFile ab = Includes("server/a/x.h", {"server/b/x.h"});
  const SourceFile bc = Includes("server/b/x.h", {"server/c/x.h"});
  const SourceFile ca = Includes("server/c/x.h", {"server/a/y.h"});
  EXPECT_THAT(FindFolderCycles({ab, bc}), IsEmpty());
  EXPECT_THAT(FindFolderCycles({ab, bc, ca}),
              ElementsAre(HasSubstr("server/a -> server/b -> server/c -> server/a")));
}

TEST(FindImpureAlgorithms, FindsSocketsAndDatabases) {
  const SourceFile file{"server/fusion/f.cc", {"#include <sqlite3.h>", "#include <vector>"}};
  const SourceFile shell{"server/store/s.cc", {"#include <sqlite3.h>"}};
  EXPECT_THAT(FindImpureAlgorithms({file, shell}), ElementsAre(HasSubstr("server/fusion/f.cc:1")));
}

TEST(FindLongFiles, FindsOneLineTooMany) {
  const SourceFile fits{"a.cc", std::vector<std::string>(3)};
  const SourceFile exceeds{"b.cc", std::vector<std::string>(4)};
  const SourceFile document{"c.md", std::vector<std::string>(4)};
  EXPECT_THAT(FindLongFiles({fits, exceeds, document}, 3), ElementsAre(HasSubstr("b.cc:4")));
}

TEST(FindWrongGuards, WantsThePath) {
  const SourceFile good{"common/x.h",
                        {"#ifndef PORTOLAN_COMMON_X_H_", "#define PORTOLAN_COMMON_X_H_",
                         "#endif  // PORTOLAN_COMMON_X_H_"}};
  SourceFile moved = good, bare{"common/z.h", {"#pragma once"}};
  moved.path = "common/y.h";
  EXPECT_THAT(FindWrongGuards({good, moved, bare}),
              ElementsAre(HasSubstr("PORTOLAN_COMMON_Y_H_"), HasSubstr("PORTOLAN_COMMON_Z_H_")));
}

TEST(FindUnlistedSources, WantsTheWholeName) {
  const SourceFile build{"common/CMakeLists.txt",
                         {"portolan_library(NAME c SOURCES my_a.cc b.cc)"}};
  EXPECT_THAT(FindUnlistedSources({build, {"common/a.cc", {}}, {"common/b.cc", {}}}),
              ElementsAre(HasSubstr("common/a.cc:1")));
}

TEST(FindMachinePaths, FindsAbsoluteOnes) {
  const std::string root = std::string("/ho") + "me/";
  EXPECT_THAT(FindMachinePaths({{"a.sh", {"cd " + root + "me", "cd src" + root + "x"}}}),
              ElementsAre(HasSubstr("a.sh:1")));
}

// From the disk: a tree with one fault each, and output folders that must not be read.
TEST(ReadTree, ReadsSourcesAndLeavesOutOutput) {
  const TempDir dir;
  dir.Write("agent/a.cc", "#include \"server/b.h\"\n");
  dir.Write("build/x.cc", "#include \"server/b.h\"\n");
  dir.Write(".git/x.cc", "");
  dir.Write("agent/a.png", "");
  const auto files = ReadTree(dir.path());
  ASSERT_EQ(files.size(), 1u);
  EXPECT_EQ(files[0].path, "agent/a.cc");
  EXPECT_THAT(FindWrongLayers(files), ElementsAre(HasSubstr("agent/a.cc:1")));
  EXPECT_THAT(FindUnlistedSources(files), ElementsAre(HasSubstr("agent/a.cc:1")));
}

}  // namespace
}  // namespace portolan
