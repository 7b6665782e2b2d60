// The rules of the source tree that no compiler checks: which folder may include which, how long a
// file may be, include guards, sources listed in CMake, no path of one machine.
#ifndef PORTOLAN_TESTS_REPOSITORY_REPOSITORY_RULES_H_
#define PORTOLAN_TESTS_REPOSITORY_REPOSITORY_RULES_H_

#include <filesystem>
#include <string>
#include <vector>

namespace portolan {

// A text file of the tree; `path` is relative to the root, with '/'.
struct SourceFile {
  std::string path;
  std::vector<std::string> lines;
};

// Sources, scripts, build files and documents under root, sorted by path. Build output, hidden
// folders and files that are not text of ours are left out.
std::vector<SourceFile> ReadTree(const std::filesystem::path& root);

// Each finding is `path:line: what is wrong`; none means that the rule holds.
//
// proto <- common <- agent, server: agent and server never include each other, nothing but tests
// includes tests.
std::vector<std::string> FindWrongLayers(const std::vector<SourceFile>& files);
// Folders include along the flow of data: of a chain of stages only a later one includes an
// earlier one.
std::vector<std::string> FindUpstreamIncludes(const std::vector<SourceFile>& files);
// No two folders include each other, directly or round a circle.
std::vector<std::string> FindFolderCycles(const std::vector<SourceFile>& files);
// Algorithm folders know no socket, database, protobuf or thread.
std::vector<std::string> FindImpureAlgorithms(const std::vector<SourceFile>& files);
std::vector<std::string> FindLongFiles(const std::vector<SourceFile>& files, size_t most_lines);
// #ifndef PORTOLAN_<PATH>_H_, #define, and #endif with the name as a comment.
std::vector<std::string> FindWrongGuards(const std::vector<SourceFile>& files);
// Every .cc is named in the CMakeLists.txt of its folder.
std::vector<std::string> FindUnlistedSources(const std::vector<SourceFile>& files);
std::vector<std::string> FindMachinePaths(const std::vector<SourceFile>& files);

}  // namespace portolan

#endif  // PORTOLAN_TESTS_REPOSITORY_REPOSITORY_RULES_H_
