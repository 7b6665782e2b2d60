#include "common/config/option_table.h"

#include <algorithm>
#include <set>

#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"

namespace portolan {
namespace {

constexpr size_t kHelpColumns = 100;
constexpr size_t kHelpIndent = 6;

// Breaks a text into lines of at most kHelpColumns, each indented.
std::string Wrap(const std::string& text) {
  std::string result, line;
  for (const absl::string_view word : absl::StrSplit(text, ' ', absl::SkipEmpty())) {
    if (!line.empty() && kHelpIndent + line.size() + 1 + word.size() > kHelpColumns) {
      result += std::string(kHelpIndent, ' ') + line + "\n";
      line.clear();
    }
    absl::StrAppend(&line, line.empty() ? "" : " ", word);
  }
  return line.empty() ? result : result + std::string(kHelpIndent, ' ') + line + "\n";
}

std::string QuotedForYaml(const std::string& text) {
  return Concat("\"", absl::StrReplaceAll(text, {{"\\", "\\\\"}, {"\"", "\\\""}}), "\"");
}

// "a.b" of "a.b.c".
std::string SectionOf(const std::string& name) {
  const size_t dot = name.rfind('.');
  return dot == std::string::npos ? "" : name.substr(0, dot);
}

std::vector<std::string> SplitList(const std::string& text) {
  if (text.empty()) return {};
  return absl::StrSplit(text, ',');
}

}  // namespace

OptionSection OptionTable::Section(std::string_view name) { return OptionSection(this, name); }

OptionTable::Option OptionTable::Described(std::string_view name, std::string_view unit,
                                           std::string_view reason) {
  Option option;
  option.name = std::string(name);
  option.unit = std::string(unit);
  option.reason = std::string(reason);
  return option;
}

void OptionTable::AddOption(Option option) {
  PORTOLAN_CHECK(Find(option.name) == nullptr);
  PORTOLAN_CHECK(option.name != "help" && option.name != "config");
  option.default_text = option.text();
  // Next to the options of the same section, the ones without section first, so that help and YAML
  // show each section once whatever the order of the calls.
  auto place = options_.end();
  std::string section = SectionOf(option.name);
  if (section.empty()) {
    place = std::find_if(options_.begin(), options_.end(),
                         [](const Option& o) { return !SectionOf(o.name).empty(); });
  }
  for (; !section.empty() && place == options_.end(); section = SectionOf(section)) {
    const auto last = std::find_if(options_.rbegin(), options_.rend(), [&](const Option& o) {
      return o.name.compare(0, section.size() + 1, section + ".") == 0;
    });
    if (last != options_.rend()) {
      place = last.base();
      break;
    }
  }
  options_.insert(place, std::move(option));
}

void OptionTable::Alias(std::string_view alias, std::string_view name) {
  PORTOLAN_CHECK(Find(name) != nullptr && Find(alias) == nullptr);
  aliases_.emplace_back(alias, name);
}

const OptionTable::Option* OptionTable::Find(std::string_view name) const {
  for (const Option& option : options_) {
    if (option.name == name) return &option;
  }
  return nullptr;
}

bool OptionTable::IsSection(const std::string& name) const {
  return std::any_of(options_.begin(), options_.end(), [&](const Option& option) {
    return option.name.compare(0, name.size() + 1, name + ".") == 0;
  });
}

Status OptionTable::UnknownOption(std::string_view name) const {
  const Option* nearest = nullptr;
  int nearest_distance = 4;  // farther names are no help
  for (const Option& option : options_) {
    const int distance = EditDistance(option.name, name);
    if (distance < nearest_distance) {
      nearest_distance = distance;
      nearest = &option;
    }
  }
  return absl::InvalidArgumentError(
      Concat("unknown option '", name, "'",
             nearest != nullptr ? Concat("; did you mean '", nearest->name, "'?") : ""));
}

Status OptionTable::LoadYaml(const std::filesystem::path& path) {
  PORTOLAN_ASSIGN_OR_RETURN(const YamlFile file, YamlFile::Load(path));
  return ApplyYaml(file);
}

Status OptionTable::ApplyYaml(const YamlFile& file) {
  if (file.root().IsNull()) return absl::OkStatus();
  return ApplyNode(file, file.root(), "");
}

Status OptionTable::ApplyNode(const YamlFile& file, const YAML::Node& node,
                              const std::string& prefix) {
  if (!node.IsMap()) {
    return file.Error(node, prefix.empty() ? "expected options as 'name: value'"
                                           : Concat(prefix, ": expected a section of options"));
  }
  std::set<std::string> seen;
  for (const auto& entry : node) {
    if (!entry.first.IsScalar()) return file.Error(entry.first, "a key must be a plain name");
    const std::string key = entry.first.Scalar();
    const std::string name = prefix.empty() ? key : Concat(prefix, ".", key);
    if (!seen.insert(key).second) return file.Error(entry.first, Concat(name, ": given twice"));
    if (const Option* option = Find(name)) {
      PORTOLAN_RETURN_IF_ERROR(ApplyScalars(file, entry.second, *option));
    } else if (!IsSection(name)) {
      return file.Error(entry.first, std::string(UnknownOption(name).message()));
    } else if (!entry.second.IsNull()) {
      PORTOLAN_RETURN_IF_ERROR(ApplyNode(file, entry.second, name));
    }
  }
  return absl::OkStatus();
}

Status OptionTable::ApplyScalars(const YamlFile& file, const YAML::Node& node,
                                 const Option& option) const {
  std::vector<std::string> texts;
  if (option.is_list && node.IsSequence()) {
    for (const YAML::Node& entry : node) {
      if (!entry.IsScalar()) {
        return file.Error(entry, Concat(option.name, ": expected a list of plain values"));
      }
      texts.push_back(entry.Scalar());
    }
  } else if (node.IsScalar() && !option.is_list) {
    texts.push_back(node.Scalar());
  } else {
    return file.Error(node, Concat(option.name, option.is_list ? ": expected a list [a, b]"
                                                               : ": expected a single value"));
  }
  const Status status = option.set(texts);
  if (!status.ok()) {
    return file.Error(node, Concat(option.name, ": ", std::string(status.message())));
  }
  return absl::OkStatus();
}

const OptionTable::Option* OptionTable::FindFlag(std::string name, bool* negated) const {
  *negated = false;
  std::replace(name.begin(), name.end(), '-', '_');
  for (const auto& [alias, full] : aliases_) {
    if (name == alias) name = full;
  }
  if (const Option* option = Find(name)) return option;
  if (name.compare(0, 3, "no_") != 0) return nullptr;
  const Option* option = Find(name.substr(3));
  if (option == nullptr || !option->is_flag) return nullptr;
  *negated = true;
  return option;
}

Status OptionTable::ApplyFlag(const std::vector<std::string>& words, size_t* index,
                              bool only_config) {
  const std::string word = words[*index].substr(2);
  const size_t equals = word.find('=');
  const std::string name = word.substr(0, equals);
  const bool is_config = name == "config";
  bool negated = false;
  const Option* option = is_config ? nullptr : FindFlag(name, &negated);
  if (!is_config && option == nullptr) return UnknownOption(name);

  std::string value;
  if (equals != std::string::npos) {
    if (negated) return absl::InvalidArgumentError(Concat("--", name, " takes no value"));
    value = word.substr(equals + 1);
  } else if (option != nullptr && option->is_flag) {
    value = negated ? "false" : "true";
  } else if (*index + 1 < words.size()) {
    value = words[++*index];
  } else {
    return absl::InvalidArgumentError(Concat("--", name, " needs a value"));
  }
  if (is_config) return only_config ? LoadYaml(value) : absl::OkStatus();
  if (only_config) return absl::OkStatus();
  const Status status =
      option->set(option->is_list ? SplitList(value) : std::vector<std::string>{value});
  if (status.ok()) return status;
  return absl::InvalidArgumentError(Concat("--", name, ": ", std::string(status.message())));
}

StatusOr<CommandLine> OptionTable::ParseCommandLine(int argc, const char* const* argv) {
  const std::vector<std::string> words(argv + std::min(argc, 1), argv + argc);
  CommandLine line;
  for (const bool only_config : {true, false}) {
    line = {};
    for (size_t i = 0; i < words.size(); ++i) {
      if (words[i] == "--") {
        line.positional.insert(line.positional.end(), words.begin() + i + 1, words.end());
        break;
      }
      if (words[i] == "--help" || words[i] == "-h") {
        line.help = true;
        return line;
      }
      if (words[i].compare(0, 2, "--") == 0) {
        PORTOLAN_RETURN_IF_ERROR(ApplyFlag(words, &i, only_config));
      } else {
        line.positional.push_back(words[i]);
      }
    }
  }
  return line;
}

std::string OptionTable::HelpOf(const Option& option) const {
  std::string head = Concat("  --", option.name);
  for (const auto& [alias, full] : aliases_) {
    if (full == option.name) absl::StrAppend(&head, ", --", alias);
  }
  absl::StrAppend(&head, "  (default ", option.default_text.empty() ? "empty" : option.default_text,
                  option.unit.empty() ? "" : " ", option.unit, ")\n");
  std::string body = option.reason;
  if (!option.choices.empty()) {
    absl::StrAppend(&body, " One of: ", absl::StrJoin(option.choices, ", "), ".");
  }
  return head + Wrap(body);
}

std::string OptionTable::Help(std::string_view usage) const {
  std::string help = Concat(usage, "\n\n  --config FILE\n");
  help += Wrap("YAML file of the options below; each dot is a level. Flags win over the file.");
  help += "  --help, -h\n" + Wrap("Prints this text.");
  std::string section;
  for (const Option& option : options_) {
    const std::string its_section = SectionOf(option.name);
    if (its_section != section) absl::StrAppend(&help, "\n", its_section, "\n");
    section = its_section;
    help += HelpOf(option);
  }
  return help;
}

std::string OptionTable::ToYaml() const {
  std::string yaml;
  std::vector<std::string> open;  // the sections the last line stands in
  for (const Option& option : options_) {
    std::vector<std::string> levels = absl::StrSplit(option.name, '.');
    const std::string key = levels.back();
    levels.pop_back();
    size_t same = 0;
    while (same < std::min(open.size(), levels.size()) && open[same] == levels[same]) ++same;
    for (size_t i = same; i < levels.size(); ++i) {
      absl::StrAppend(&yaml, std::string(2 * i, ' '), levels[i], ":\n");
    }
    open = levels;
    const std::string indent(2 * levels.size(), ' ');
    absl::StrAppend(&yaml, indent, "# ", option.reason,
                    option.unit.empty() ? "" : Concat(" [", option.unit, "]"), "\n");
    if (!option.choices.empty()) {
      absl::StrAppend(&yaml, indent, "# One of: ", absl::StrJoin(option.choices, ", "), "\n");
    }
    std::string value = option.text();
    if (option.is_list) {
      std::vector<std::string> entries = SplitList(value);
      for (std::string& entry : entries) entry = QuotedForYaml(entry);
      value = Concat("[", absl::StrJoin(entries, ", "), "]");
    } else if (value.empty() || value.find_first_of(" :#\"'[]{},&*!|>%@`\\") != std::string::npos) {
      value = QuotedForYaml(value);
    }
    absl::StrAppend(&yaml, indent, key, ": ", value, "\n");
  }
  return yaml;
}

}  // namespace portolan
