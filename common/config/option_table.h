// One table of a program's options, that drives the YAML file, the command line and --help alike.
//
//   OptionTable table;
//   OptionSection tracker = table.Section("tracker");
//   tracker.Add("max_points", &options.max_points, "points", "more cost time, fewer lose
//   accuracy"); const auto line = table.ParseCommandLine(argc, argv); if (line->help) std::cout <<
//   table.Help("usage: portolan-agent [flags] FOLDER");
//
// reads `tracker: {max_points: 200}` and `--tracker.max_points 200` or `--tracker.max_points=200`.
#ifndef PORTOLAN_COMMON_CONFIG_OPTION_TABLE_H_
#define PORTOLAN_COMMON_CONFIG_OPTION_TABLE_H_

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/base/concat.h"
#include "common/base/status.h"
#include "common/config/option_text.h"
#include "common/config/yaml_file.h"

namespace portolan {

// What the operator typed besides options.
struct CommandLine {
  bool help = false;
  std::vector<std::string> positional;
};

// The names of an enumeration's values. (The identity keeps the compiler from deducing Enum here.)
template <typename Enum>
using OptionChoices = std::type_identity_t<std::vector<std::pair<std::string, Enum>>>;

class OptionSection;

// The targets of Add must outlive the table. Thread-compatible; for the start of `main` only.
class OptionTable {
 public:
  // Adds an option whose value, as it is now, is the default. `name` may have dots: each is a
  // level of nesting in YAML. `unit` may be empty; `reason` says what it does and why the default.
  template <typename T>
  void Add(std::string_view name, T* target, std::string_view unit, std::string_view reason);
  // No value is "none".
  template <typename T>
  void Add(std::string_view name, std::optional<T>* target, std::string_view unit,
           std::string_view reason);
  // A YAML list, or values separated by commas on the command line.
  template <typename T>
  void Add(std::string_view name, std::vector<T>* target, std::string_view unit,
           std::string_view reason);
  // An enumeration by name.
  template <typename Enum>
  void AddChoice(std::string_view name, Enum* target, OptionChoices<Enum> choices,
                 std::string_view reason);

  // Options added to the section get "name." in front.
  OptionSection Section(std::string_view name);
  // `--alias` on the command line stands for `--name`; not in YAML.
  void Alias(std::string_view alias, std::string_view name);

  // Sets the options the file names. Unknown and repeated keys, wrong types: InvalidArgument with
  // file, line and key. Options not named keep their values.
  Status LoadYaml(const std::filesystem::path& path);
  Status ApplyYaml(const YamlFile& file);

  // Reads `--config FILE` first (if given), then all other flags, so that flags win over files.
  // Flags: `--name value`, `--name=value`; a bool is set by `--name` alone, `--name=false`, or
  // unset by `--no-name`; `-` and `_` are the same in names; `--` ends the flags; `--help`, `-h`.
  StatusOr<CommandLine> ParseCommandLine(int argc, const char* const* argv);

  // `usage`, then every option with its default, unit and reason.
  std::string Help(std::string_view usage) const;
  // A YAML file with all options at their present values, each with its reason as a comment.
  std::string ToYaml() const;

 private:
  struct Option {
    std::string name, unit, reason, default_text;
    std::vector<std::string> choices;
    bool is_flag = false;  // a bool: needs no value
    bool is_list = false;
    std::function<Status(const std::vector<std::string>&)> set;
    std::function<std::string()> text;
  };

  static Option Described(std::string_view name, std::string_view unit, std::string_view reason);
  void AddOption(Option option);
  const Option* Find(std::string_view name) const;
  Status UnknownOption(std::string_view name) const;
  Status ApplyNode(const YamlFile& file, const YAML::Node& node, const std::string& prefix);
  Status ApplyScalars(const YamlFile& file, const YAML::Node& node, const Option& option) const;
  bool IsSection(const std::string& name) const;
  // The option that a flag's name means, through alias, hyphens and "no-" (which sets *negated).
  const Option* FindFlag(std::string name, bool* negated) const;
  // Reads the flag at argv[*index]; moves *index to the last word it took.
  Status ApplyFlag(const std::vector<std::string>& words, size_t* index, bool only_config);
  std::string HelpOf(const Option& option) const;

  std::vector<Option> options_;
  std::vector<std::pair<std::string, std::string>> aliases_;
};

// A prefix of a table; a module adds its options to it without knowing where they end up.
class OptionSection {
 public:
  OptionSection(OptionTable* table, std::string_view prefix)
      : table_(table), prefix_(Concat(prefix, ".")) {}

  template <typename T>
  void Add(std::string_view name, T* target, std::string_view unit, std::string_view reason) {
    table_->Add(prefix_ + std::string(name), target, unit, reason);
  }
  template <typename Enum>
  void AddChoice(std::string_view name, Enum* target, OptionChoices<Enum> choices,
                 std::string_view reason) {
    table_->AddChoice(prefix_ + std::string(name), target, std::move(choices), reason);
  }
  OptionSection Section(std::string_view name) const {
    return OptionSection(table_, prefix_ + std::string(name));
  }

 private:
  OptionTable* table_;
  std::string prefix_;
};

template <typename T>
void OptionTable::Add(std::string_view name, T* target, std::string_view unit,
                      std::string_view reason) {
  Option option = Described(name, unit, reason);
  option.is_flag = std::is_same_v<T, bool>;
  option.set = [target](const std::vector<std::string>& texts) {
    return ParseOptionText(texts.front(), target);
  };
  option.text = [target] { return OptionTextOf(*target); };
  AddOption(std::move(option));
}

template <typename T>
void OptionTable::Add(std::string_view name, std::optional<T>* target, std::string_view unit,
                      std::string_view reason) {
  Option option = Described(name, unit, reason);
  option.set = [target](const std::vector<std::string>& texts) -> Status {
    if (texts.front() == "none") {
      target->reset();
      return absl::OkStatus();
    }
    T value{};
    PORTOLAN_RETURN_IF_ERROR(ParseOptionText(texts.front(), &value));
    *target = std::move(value);
    return absl::OkStatus();
  };
  option.text = [target] { return target->has_value() ? OptionTextOf(**target) : "none"; };
  AddOption(std::move(option));
}

template <typename T>
void OptionTable::Add(std::string_view name, std::vector<T>* target, std::string_view unit,
                      std::string_view reason) {
  Option option = Described(name, unit, reason);
  option.is_list = true;
  option.set = [target](const std::vector<std::string>& texts) -> Status {
    std::vector<T> values(texts.size());
    for (size_t i = 0; i < texts.size(); ++i) {
      PORTOLAN_RETURN_IF_ERROR(ParseOptionText(texts[i], &values[i]));
    }
    *target = std::move(values);
    return absl::OkStatus();
  };
  option.text = [target] {
    std::string text;
    for (const T& value : *target) text += (text.empty() ? "" : ",") + OptionTextOf(value);
    return text;
  };
  AddOption(std::move(option));
}

template <typename Enum>
void OptionTable::AddChoice(std::string_view name, Enum* target, OptionChoices<Enum> choices,
                            std::string_view reason) {
  Option option = Described(name, "", reason);
  for (const auto& choice : choices) option.choices.push_back(choice.first);
  option.set = [target, choices](const std::vector<std::string>& texts) -> Status {
    std::string known;
    for (const auto& [text, value] : choices) {
      if (text == texts.front()) {
        *target = value;
        return absl::OkStatus();
      }
      known += (known.empty() ? "" : ", ") + text;
    }
    return absl::InvalidArgumentError(
        Concat("expected one of ", known, ", not '", texts.front(), "'"));
  };
  option.text = [target, choices]() -> std::string {
    for (const auto& [text, value] : choices) {
      if (value == *target) return text;
    }
    CheckFailed(__FILE__, __LINE__, "the value is one of the choices");
  };
  AddOption(std::move(option));
}

}  // namespace portolan

#endif  // PORTOLAN_COMMON_CONFIG_OPTION_TABLE_H_
