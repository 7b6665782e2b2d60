#include "tests/repository/repository_rules.h"

#include <algorithm>
#include <fstream>
#include <map>
#include <optional>
#include <set>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;

// Stages in the order of the flow; a folder not named here is bound by the other rules only.
const std::vector<std::vector<std::string>> kFlows = {
    {"common/base", "common/geometry", "common/camera", "common/submap", "common/wire",
     "common/client"},
    {"agent/image_source", "agent/tracker", "agent/filter", "agent/submap", "agent/uplink"},
    {"server/refinement", "server/redundancy", "server/place_recognition", "server/verification",
     "server/alignment", "server/fusion", "server/rpc", "server/cli"},
};

const std::set<std::string> kAlgorithmFolders = {
    "common/geometry",          "common/camera",       "common/features",   "common/submap",
    "common/trajectory",        "agent/tracker",       "agent/filter",      "agent/submap",
    "server/refinement",        "server/verification", "server/alignment",  "server/fusion",
    "server/place_recognition", "agent/landmarks",     "server/pose_graph", "server/redundancy",
};

// Value types that every stage of the server reads, though one of them owns the header; they have
// no code, so no stage comes to depend on another through them.
const std::set<std::string> kSharedValueTypes = {"server/fusion/map_state.h"};

// Prefixes of includes, as written between quotes or brackets.
const std::vector<std::string> kImpureIncludes = {
    "grpc",  "google/protobuf",    "sqlite3",   "proto/", "thread",
    "mutex", "condition_variable", "sys/socket"};

bool IsSource(const std::string& path) {
  return absl::EndsWith(path, ".h") || absl::EndsWith(path, ".cc");
}

std::string FolderOf(const std::string& path) {
  const size_t slash = path.rfind('/');
  return slash == std::string::npos ? "" : path.substr(0, slash);
}

std::string TopFolder(const std::string& path) { return path.substr(0, path.find('/')); }

// What a line includes, without quotes or brackets.
std::optional<std::string> IncludedPath(const std::string& line) {
  absl::string_view text = absl::StripAsciiWhitespace(line);
  if (!absl::ConsumePrefix(&text, "#")) return std::nullopt;
  text = absl::StripLeadingAsciiWhitespace(text);
  if (!absl::ConsumePrefix(&text, "include")) return std::nullopt;
  text = absl::StripLeadingAsciiWhitespace(text);
  if (text.empty() || (text.front() != '"' && text.front() != '<')) return std::nullopt;
  const size_t end = text.find(text.front() == '"' ? '"' : '>', 1);
  if (end == absl::string_view::npos) return std::nullopt;
  return std::string(text.substr(1, end - 1));
}

std::string Finding(const SourceFile& file, size_t line_index, const std::string& message) {
  return absl::StrCat(file.path, ":", line_index + 1, ": ", message);
}

// Calls visit(file, line index, included path) for every include of the tree.
template <typename Visitor>
void ForEachInclude(const std::vector<SourceFile>& files, const Visitor& visit) {
  for (const SourceFile& file : files) {
    if (!IsSource(file.path)) continue;
    for (size_t i = 0; i < file.lines.size(); ++i) {
      const auto included = IncludedPath(file.lines[i]);
      if (included) visit(file, i, *included);
    }
  }
}

bool MayInclude(const std::string& from, const std::string& to) {
  static const std::map<std::string, std::set<std::string>> kAllowed = {
      {"proto", {"proto"}},
      {"common", {"proto", "common"}},
      {"agent", {"proto", "common", "agent"}},
      {"server", {"proto", "common", "server"}},
      {"tests", {"proto", "common", "agent", "server", "tests"}}};
  static const std::set<std::string> kLayers = {"proto", "common", "agent", "server", "tests"};
  if (kLayers.count(to) == 0) return true;  // not ours
  const auto allowed = kAllowed.find(from);
  return allowed != kAllowed.end() && allowed->second.count(to) > 0;
}

using FolderGraph = std::map<std::string, std::set<std::string>>;

// A circle of folders reachable from `folder`, or nothing. `path` is the walk so far.
std::vector<std::string> FindCycleFrom(const FolderGraph& graph, const std::string& folder,
                                       std::vector<std::string>* path,
                                       std::set<std::string>* done) {
  const auto on_path = std::find(path->begin(), path->end(), folder);
  if (on_path != path->end()) {
    std::vector<std::string> cycle(on_path, path->end());
    cycle.push_back(folder);
    return cycle;
  }
  if (done->count(folder) > 0 || graph.count(folder) == 0) return {};
  path->push_back(folder);
  for (const std::string& next : graph.at(folder)) {
    const std::vector<std::string> cycle = FindCycleFrom(graph, next, path, done);
    if (!cycle.empty()) return cycle;
  }
  path->pop_back();
  done->insert(folder);
  return {};
}

std::vector<std::string> ReadLines(const fs::path& path) {
  std::ifstream input(path);
  std::vector<std::string> lines;
  for (std::string line; std::getline(input, line);) lines.push_back(line);
  return lines;
}

bool IsText(const fs::path& path) {
  static const std::set<std::string> kEndings = {".h",     ".cc", ".txt",  ".cmake", ".sh",
                                                 ".proto", ".md", ".yaml", ".json",  ".service"};
  return kEndings.count(path.extension().string()) > 0;
}

}  // namespace

std::vector<SourceFile> ReadTree(const fs::path& root) {
  std::vector<SourceFile> files;
  for (auto entry = fs::recursive_directory_iterator(root); entry != fs::end(entry); ++entry) {
    const std::string name = entry->path().filename().string();
    if (entry->is_directory()) {
      const bool is_output = entry.depth() == 0 && (name == "build" || name == "out");
      if (is_output || absl::StartsWith(name, ".")) entry.disable_recursion_pending();
    } else if (entry->is_regular_file() && IsText(entry->path())) {
      files.push_back(
          {entry->path().lexically_relative(root).generic_string(), ReadLines(entry->path())});
    }
  }
  std::sort(files.begin(), files.end(),
            [](const SourceFile& a, const SourceFile& b) { return a.path < b.path; });
  return files;
}

std::vector<std::string> FindWrongLayers(const std::vector<SourceFile>& files) {
  std::vector<std::string> findings;
  ForEachInclude(files, [&](const SourceFile& file, size_t line, const std::string& included) {
    if (!MayInclude(TopFolder(file.path), TopFolder(included))) {
      findings.push_back(
          Finding(file, line,
                  absl::StrCat(TopFolder(file.path), " must not include ", TopFolder(included))));
    }
  });
  return findings;
}

std::vector<std::string> FindUpstreamIncludes(const std::vector<SourceFile>& files) {
  std::vector<std::string> findings;
  ForEachInclude(files, [&](const SourceFile& file, size_t line, const std::string& included) {
    for (const std::vector<std::string>& flow : kFlows) {
      const auto from = std::find(flow.begin(), flow.end(), FolderOf(file.path));
      const auto to = std::find(flow.begin(), flow.end(), FolderOf(included));
      if (from == flow.end() || to == flow.end() || to <= from) continue;
      if (kSharedValueTypes.count(included) > 0) continue;
      findings.push_back(
          Finding(file, line, absl::StrCat(*from, " comes before ", *to, " in the flow")));
    }
  });
  return findings;
}

std::vector<std::string> FindFolderCycles(const std::vector<SourceFile>& files) {
  FolderGraph graph;
  ForEachInclude(files, [&](const SourceFile& file, size_t, const std::string& included) {
    const std::string from = FolderOf(file.path), to = FolderOf(included);
    if (kSharedValueTypes.count(included) > 0) return;
    if (from != to && TopFolder(from) != "tests" && to.find('/') != std::string::npos) {
      graph[from].insert(to);
    }
  });
  std::vector<std::string> path;
  std::set<std::string> done;
  for (const auto& [folder, targets] : graph) {
    const std::vector<std::string> cycle = FindCycleFrom(graph, folder, &path, &done);
    if (!cycle.empty()) {
      return {absl::StrCat("folders include each other: ", absl::StrJoin(cycle, " -> "))};
    }
  }
  return {};
}

std::vector<std::string> FindImpureAlgorithms(const std::vector<SourceFile>& files) {
  std::vector<std::string> findings;
  ForEachInclude(files, [&](const SourceFile& file, size_t line, const std::string& included) {
    if (kAlgorithmFolders.count(FolderOf(file.path)) == 0) return;
    for (const std::string& impure : kImpureIncludes) {
      if (absl::StartsWith(included, impure)) {
        findings.push_back(
            Finding(file, line, absl::StrCat("an algorithm folder must not include ", included)));
      }
    }
  });
  return findings;
}

std::vector<std::string> FindLongFiles(const std::vector<SourceFile>& files, size_t most_lines) {
  std::vector<std::string> findings;
  for (const SourceFile& file : files) {
    if (!IsSource(file.path) || file.lines.size() <= most_lines) continue;
    findings.push_back(Finding(file, file.lines.size() - 1,
                               absl::StrCat("more than ", most_lines, " lines in a file")));
  }
  return findings;
}

std::vector<std::string> FindWrongGuards(const std::vector<SourceFile>& files) {
  std::vector<std::string> findings;
  for (const SourceFile& file : files) {
    if (!absl::EndsWith(file.path, ".h")) continue;
    const std::string guard = absl::StrCat(
        "PORTOLAN_",
        absl::AsciiStrToUpper(absl::StrReplaceAll(file.path, {{"/", "_"}, {".", "_"}, {"-", "_"}})),
        "_");
    const auto has = [&](const std::string& line) {
      return std::find(file.lines.begin(), file.lines.end(), line) != file.lines.end();
    };
    if (!has("#ifndef " + guard) || !has("#define " + guard) || !has("#endif  // " + guard)) {
      findings.push_back(Finding(file, 0, absl::StrCat("include guard is not ", guard)));
    }
  }
  return findings;
}

std::vector<std::string> FindUnlistedSources(const std::vector<SourceFile>& files) {
  std::map<std::string, std::string> build_files;  // by folder
  for (const SourceFile& file : files) {
    if (absl::EndsWith(file.path, "CMakeLists.txt")) {
      build_files[FolderOf(file.path)] = absl::StrJoin(file.lines, " ");
    }
  }
  std::vector<std::string> findings;
  for (const SourceFile& file : files) {
    if (!absl::EndsWith(file.path, ".cc")) continue;
    const std::string folder = FolderOf(file.path);
    const std::string name = file.path.substr(folder.empty() ? 0 : folder.size() + 1);
    const std::vector<std::string> words =
        absl::StrSplit(build_files[folder], absl::ByAnyChar(" \t()\""), absl::SkipEmpty());
    if (std::find(words.begin(), words.end(), name) == words.end()) {
      findings.push_back(Finding(file, 0, "not listed in its folder's CMakeLists.txt"));
    }
  }
  return findings;
}

std::vector<std::string> FindMachinePaths(const std::vector<SourceFile>& files) {
  // Spelled in two parts, so that this file does not find itself.
  const std::vector<std::string> roots = {
      "/ho"
      "me/",
      "/wo"
      "rk/",
      "/ro"
      "ot/",
      "/Us"
      "ers/"};
  std::vector<std::string> findings;
  for (const SourceFile& file : files) {
    for (size_t i = 0; i < file.lines.size(); ++i) {
      for (const std::string& root : roots) {
        const size_t at = file.lines[i].find(root);
        if (at == std::string::npos) continue;
        // A path that goes on from a name (src/work/...) is relative.
        const char before = at == 0 ? ' ' : file.lines[i][at - 1];
        if (absl::ascii_isalnum(static_cast<unsigned char>(before)) || before == '.') continue;
        findings.push_back(Finding(file, i, absl::StrCat("path of one machine: ", root)));
      }
    }
  }
  return findings;
}

}  // namespace portolan
