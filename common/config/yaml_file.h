// A YAML file read without exceptions: every error names the file, the line and the key.
#ifndef PORTOLAN_COMMON_CONFIG_YAML_FILE_H_
#define PORTOLAN_COMMON_CONFIG_YAML_FILE_H_

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"

namespace portolan {

// A parsed file and typed, checked access to its nodes. Thread-compatible.
class YamlFile {
 public:
  // NotFound if the file cannot be read; InvalidArgument with the line if it is not YAML. The
  // header line "%YAML:1.0" that OpenCV writes is accepted.
  static StatusOr<YamlFile> Load(const std::filesystem::path& path);
  // The same of a text; `name` stands for the file in errors.
  static StatusOr<YamlFile> Parse(std::string_view text, std::string_view name);

  const YAML::Node& root() const { return root_; }
  const std::string& name() const { return name_; }

  // True if `parent` is a map that holds `key` with a value.
  static bool Has(const YAML::Node& parent, const std::string& key);

  // The value under `key` of the map `parent`. InvalidArgument if it is missing, of another type,
  // or a number is not finite.
  StatusOr<YAML::Node> Child(const YAML::Node& parent, const std::string& key) const;
  StatusOr<double> Number(const YAML::Node& parent, const std::string& key) const;
  StatusOr<int> Integer(const YAML::Node& parent, const std::string& key) const;
  StatusOr<std::string> Text(const YAML::Node& parent, const std::string& key) const;
  // A sequence of numbers; sequences inside it (rows of a matrix) are joined.
  StatusOr<std::vector<double>> Numbers(const YAML::Node& parent, const std::string& key) const;

  // "file:line: message", the line being that of `at`.
  Status Error(const YAML::Node& at, std::string_view message) const;

 private:
  YamlFile(std::string name, YAML::Node root) : name_(std::move(name)), root_(std::move(root)) {}

  Status AppendNumbers(const YAML::Node& node, const std::string& key,
                       std::vector<double>* numbers) const;

  std::string name_;
  YAML::Node root_;
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_CONFIG_YAML_FILE_H_
