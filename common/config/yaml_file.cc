#include "common/config/yaml_file.h"

#include <cmath>
#include <fstream>
#include <sstream>

#include "absl/strings/numbers.h"
#include "common/base/concat.h"

namespace portolan {
namespace {

constexpr std::string_view kOpenCvHeader = "%YAML:";

// The header line is blanked, not removed, so that line numbers stay true.
std::string WithoutOpenCvHeader(std::string_view text) {
  std::string result(text);
  if (text.substr(0, kOpenCvHeader.size()) == kOpenCvHeader) {
    const size_t end = std::min(result.find('\n'), result.size());
    result.replace(0, end, end, ' ');
  }
  return result;
}

}  // namespace

StatusOr<YamlFile> YamlFile::Load(const std::filesystem::path& path) {
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) {
    return absl::NotFoundError(Concat(path, ": is a folder, not a file"));
  }
  std::ifstream file(path, std::ios::binary);
  if (!file) return absl::NotFoundError(Concat(path, ": cannot be opened"));
  std::ostringstream text;
  text << file.rdbuf();
  if (file.bad()) return absl::NotFoundError(Concat(path, ": cannot be read"));
  return Parse(text.str(), path.string());
}

StatusOr<YamlFile> YamlFile::Parse(std::string_view text, std::string_view name) {
  try {
    return YamlFile(std::string(name), YAML::Load(WithoutOpenCvHeader(text)));
  } catch (const YAML::Exception& exception) {
    return absl::InvalidArgumentError(
        Concat(name, ":", exception.mark.line + 1, ": not YAML: ", exception.msg));
  }
}

bool YamlFile::Has(const YAML::Node& parent, const std::string& key) {
  return parent.IsMap() && parent[key].IsDefined() && !parent[key].IsNull();
}

Status YamlFile::Error(const YAML::Node& at, std::string_view message) const {
  const int line = at.IsDefined() ? at.Mark().line : -1;
  if (line < 0) return absl::InvalidArgumentError(Concat(name_, ": ", message));
  return absl::InvalidArgumentError(Concat(name_, ":", line + 1, ": ", message));
}

StatusOr<YAML::Node> YamlFile::Child(const YAML::Node& parent, const std::string& key) const {
  if (!parent.IsMap()) return Error(parent, Concat("expected a map with the key '", key, "'"));
  if (!Has(parent, key)) return Error(parent, Concat("key '", key, "' is missing"));
  return parent[key];
}

StatusOr<double> YamlFile::Number(const YAML::Node& parent, const std::string& key) const {
  PORTOLAN_ASSIGN_OR_RETURN(const YAML::Node node, Child(parent, key));
  double value;
  if (!node.IsScalar() || !absl::SimpleAtod(node.Scalar(), &value) || !std::isfinite(value)) {
    return Error(node, Concat(key, ": expected a finite number",
                              node.IsScalar() ? Concat(", not '", node.Scalar(), "'") : ""));
  }
  return value;
}

StatusOr<int> YamlFile::Integer(const YAML::Node& parent, const std::string& key) const {
  PORTOLAN_ASSIGN_OR_RETURN(const double value, Number(parent, key));
  if (value != std::floor(value) || std::abs(value) > 1e9) {
    return Error(parent[key], Concat(key, ": expected a whole number, not ", value));
  }
  return static_cast<int>(value);
}

StatusOr<std::string> YamlFile::Text(const YAML::Node& parent, const std::string& key) const {
  PORTOLAN_ASSIGN_OR_RETURN(const YAML::Node node, Child(parent, key));
  if (!node.IsScalar()) return Error(node, Concat(key, ": expected text"));
  return node.Scalar();
}

StatusOr<std::vector<double>> YamlFile::Numbers(const YAML::Node& parent,
                                                const std::string& key) const {
  PORTOLAN_ASSIGN_OR_RETURN(const YAML::Node node, Child(parent, key));
  if (!node.IsSequence()) return Error(node, Concat(key, ": expected a list of numbers"));
  std::vector<double> numbers;
  PORTOLAN_RETURN_IF_ERROR(AppendNumbers(node, key, &numbers));
  return numbers;
}

Status YamlFile::AppendNumbers(const YAML::Node& node, const std::string& key,
                               std::vector<double>* numbers) const {
  for (const YAML::Node& entry : node) {
    if (entry.IsSequence()) {
      PORTOLAN_RETURN_IF_ERROR(AppendNumbers(entry, key, numbers));
      continue;
    }
    double value;
    if (!entry.IsScalar() || !absl::SimpleAtod(entry.Scalar(), &value) || !std::isfinite(value)) {
      return Error(entry, Concat(key, ": entry ", numbers->size(), " is not a finite number"));
    }
    numbers->push_back(value);
  }
  return absl::OkStatus();
}

}  // namespace portolan
