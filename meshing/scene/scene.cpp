#include "meshing/scene/scene.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>
#include <sstream>
#include <stdexcept>

#include "meshing/base/files.h"
#include "meshing/base/names.h"
#include "meshing/base/toml.h"
#include "meshing/scene/scene_keys.h"

namespace testbed::meshing {
namespace {

namespace fs = std::filesystem;

template <class T>
struct IsVector : std::false_type {};
template <class T>
struct IsVector<std::vector<T>> : std::true_type {};

/// Keys of earlier scenes and what they are called now.
const std::map<std::string, std::string> kRenamed{{"reference.law", "material.law"},
                                                  {"reference.tolerance", "time.residual"}};

/// Fills the scene's structs from a TOML table and refuses every key it was not asked for.
class Reader {
 public:
  /// @param path  of the table: "" or "material" or "loads.0"
  /// @param places  of keys, to which those of this table are added
  Reader(const toml::table& table, std::string path, std::map<std::string, std::string>& places)
      : table_(table), path_(std::move(path)), places_(places) {}

  template <class T>
  void operator()(const char* key, T& value, const Range& range, const char* meaning) {
    if (const toml::node* node = find(key)) read(*node, full(key), value, range, meaning);
  }
  template <class T>
  void operator()(const char* key, T& value, const char* meaning) {
    (*this)(key, value, kAny, meaning);
  }
  template <class T>
  void required(const char* key, T& value, const Range& range, const char* meaning) {
    (*this)(key, value, range, meaning);
    if (!table_.contains(key)) fail(table_, full(key) + " is missing, expected " + meaning);
  }
  void path(const char* key, std::string& value, const char* meaning) {
    (*this)(key, value, meaning);
    if (value.empty()) return;
    const toml::node& node = *table_.get(key);
    const fs::path base =
        is_override(source_of(node)) ? fs::current_path() : fs::path(source_of(node)).parent_path();
    const fs::path file = fs::absolute(base / value).lexically_normal();
    if (!fs::is_regular_file(file)) wrong(node, full(key), "a file; there is no " + file.string());
    value = file.string();
  }
  template <class Enum>
  void choice(const char* key, Enum& value, const char* meaning) {
    const toml::node* node = find(key);
    if (!node) return;
    std::string name;
    read(*node, full(key), name, kAny, meaning);
    expect_one_of(all_names<Enum>(), *node, full(key), name);
    value = *meshing::value_of<Enum>(name);
  }
  template <class Enum>
  void choice(const char* key, std::optional<Enum>& value, const char* meaning) {
    if (find(key)) choice(key, value.emplace(), meaning);
  }
  void choice(const char* key, std::string& value, const std::vector<std::string>& names,
              const char* meaning) {
    const toml::node* node = find(key);
    if (!node) return;
    const bool may_be_empty = value.empty();
    read(*node, full(key), value, kAny, meaning);
    if (!value.empty() || !may_be_empty) expect_one_of(names, *node, full(key), value);
  }
  void choice(const char* key, std::vector<std::string>& values, const std::vector<std::string>& names,
              const char* meaning) {
    const toml::node* node = find(key);
    if (!node) return;
    read(*node, full(key), values, kAny, meaning);
    for (size_t i = 0; i < values.size(); ++i)
      expect_one_of(names, (*node->as_array())[i], full(key), values[i]);
  }
  void components(const char* key, std::array<bool, 3>& fixed, const char* meaning) {
    const toml::node* node = find(key);
    if (!node) return;
    std::string letters;
    read(*node, full(key), letters, kAny, meaning);
    if (letters.empty() || letters.find_first_not_of("xyz") != std::string::npos)
      wrong(*node, full(key), "letters of \"xyz\"");
    for (int c = 0; c < 3; ++c) fixed[c] = letters.find("xyz"[c]) != std::string::npos;
  }
  template <class T>
  void table(const char* key, T& value) {
    if (const toml::node* node = find(key)) read_table(*node, full(key), value);
  }
  template <class T>
  void table(const char* key, std::optional<T>& value) {
    if (const toml::node* node = find(key)) read_table(*node, full(key), value.emplace());
  }
  template <class T>
  void inline_table(const char* key, T& value, const char*) {
    table(key, value);
  }
  template <class T>
  void list(const char* key, std::vector<T>& values) {
    const toml::node* node = find(key);
    if (!node) return;
    const toml::array* array = node->as_array();
    if (!array) wrong(*node, full(key), "tables [[" + full(key) + "]]");
    for (size_t i = 0; i < array->size(); ++i)
      read_table((*array)[i], full(key) + "." + std::to_string(i), values.emplace_back());
  }
  template <class T, class Variant>
  void alternative(const char* key, Variant& shape) {
    const toml::node* node = find(key);
    if (!node) return;
    if (!chosen_.empty())
      fail(*node, path_ + " has both " + chosen_ + " and " + key + ", expected one of them");
    chosen_ = key;
    T value;
    read_table(*node, full(key), value);
    shape = value;
  }
  void at_most_one(const std::vector<const char*>& keys) const {
    const char* given = nullptr;
    for (const char* key : keys) {
      const toml::node* node = table_.get(key);
      if (node && given) fail(*node, path_ + " has both " + given + " and " + key + ", expected one of them");
      if (node) given = key;
    }
  }
  void needs_alternative(const char* expected) const {
    if (chosen_.empty()) fail(table_, path_ + " has no shape, expected " + expected);
  }
  void check(const char* key, bool is_right, const char* expected) const {
    if (!is_right) wrong(*table_.get(key), full(key), expected);
  }

  void refuse_unknown_keys() const {
    for (const auto& [key, node] : table_) {
      const std::string name(key.str());
      if (std::find(known_.begin(), known_.end(), name) != known_.end()) continue;
      const auto renamed = kRenamed.find(full(name));
      fail(node, full(name) + " = " + value_of(node) +
                     (renamed == kRenamed.end() ? ": unknown key" + suggestion(name, known_)
                                                : ": this key is " + renamed->second + " now"));
    }
  }

 private:
  static bool is_override(const std::string& source) { return source.rfind("--set", 0) == 0; }
  static std::string source_of(const toml::node& node) { return *node.source().path; }

  [[noreturn]] static void fail(const toml::node& node, const std::string& what) {
    throw std::runtime_error(place_of(node) + ": " + what);
  }

  static std::string place_of(const toml::node& node) {
    const std::string source = source_of(node);
    return is_override(source) ? source : source + ":" + std::to_string(node.source().begin.line);
  }

  static void expect_one_of(const std::vector<std::string>& names, const toml::node& node,
                            const std::string& key, const std::string& name) {
    if (std::find(names.begin(), names.end(), name) == names.end())
      fail(node, key + " = " + toml_text(name) + ": unknown name" + suggestion(name, names));
  }

  static std::string value_of(const toml::node& node) {
    if (const auto* number = node.as_floating_point()) return toml_text(number->get());
    if (const auto* text = node.as_string()) return toml_text(text->get());
    const bool has_tables = node.is_table() || node.is_array_of_tables();
    if (const toml::array* array = node.as_array(); array && !has_tables) {
      std::vector<std::string> values;
      for (const toml::node& value : *array) values.push_back(value_of(value));
      return values.empty() ? "[]" : "[ " + joined(values) + " ]";
    }
    std::ostringstream found;
    if (has_tables)
      found << node.type();
    else
      node.visit([&](const auto& value) { found << value; });
    return found.str();
  }

  [[noreturn]] static void wrong(const toml::node& node, const std::string& key,
                                 const std::string& expected) {
    fail(node, key + " = " + value_of(node) + ", expected " + expected);
  }

  std::string full(const std::string& key) const { return path_.empty() ? key : path_ + "." + key; }

  const toml::node* find(const char* key) {
    known_.emplace_back(key);
    const toml::node* node = table_.get(key);
    if (node) places_[full(key)] = place_of(*node);
    return node;
  }

  template <class T>
  void read_table(const toml::node& node, const std::string& path, T& value) {
    const toml::table* table = node.as_table();
    if (!table) wrong(node, path, "a table");
    Reader reader(*table, path, places_);
    describe(reader, value);
    reader.refuse_unknown_keys();
  }

  template <class T>
  static void read(const toml::node& node, const std::string& key, T& value, const Range& range,
                   const char* meaning) {
    const auto refuse = [&](const std::string& expected) { wrong(node, key, expected + ": " + meaning); };
    if constexpr (std::is_same_v<T, double>) {
      if (!node.is_number() || !std::isfinite(*node.value<double>())) refuse("a number");
      value = *node.value<double>();
      if (!range.holds(value)) refuse(range.expected);
    } else if constexpr (std::is_same_v<T, bool>) {
      if (!node.is_boolean()) refuse("true or false");
      value = *node.value<bool>();
    } else if constexpr (std::is_integral_v<T>) {
      if (!node.is_integer()) refuse("an integer");
      const std::int64_t number = *node.value<std::int64_t>();
      if (!range.holds(static_cast<double>(number))) refuse(range.expected);
      value = static_cast<T>(number);
      if (static_cast<std::int64_t>(value) != number) refuse("below 2^31");
    } else if constexpr (std::is_same_v<T, std::string>) {
      if (!node.is_string()) refuse("a string in quotes");
      value = *node.value<std::string>();
    } else if constexpr (std::is_base_of_v<Eigen::MatrixBase<T>, T>) {
      const toml::array* array = node.as_array();
      if (!array || array->size() != T::SizeAtCompileTime)
        refuse(T::SizeAtCompileTime == 3 ? "three numbers [x, y, z]"
                                         : std::to_string(T::SizeAtCompileTime) + " numbers");
      // A range is that of values, not of the time in front of them.
      constexpr bool kHasTime = T::SizeAtCompileTime != 3;
      for (int c = 0; c < T::SizeAtCompileTime; ++c)
        read((*array)[c], key + "." + std::to_string(c), value(c), kHasTime && c == 0 ? kAny : range,
             meaning);
    } else if constexpr (IsVector<T>::value) {
      const toml::array* array = node.as_array();
      if (!array) refuse("a list");
      value.resize(array->size());
      for (size_t i = 0; i < array->size(); ++i)
        read((*array)[i], key + "." + std::to_string(i), value[i], range, meaning);
    } else {  // std::optional
      read(node, key, value.emplace(), range, meaning);
    }
  }

  const toml::table& table_;
  std::string path_;
  std::map<std::string, std::string>& places_;
  std::vector<std::string> known_;
  std::string chosen_;
};

/// Refuses what the parser does not bear. Keys of more parts than any scene has open tables that are left by a recursion,
/// which a million of them ends by a full stack; lists and inline tables it bounds itself. Whether a letter beyond ASCII is a
/// blank it finds out by undefined behaviour.
void check_text(const std::string& text, const std::string& source) {
  constexpr int kMostParts = 100;
  const std::string byte_order_mark = "\xEF\xBB\xBF";
  int line = 1, n_dots = 0;
  char quote = 0;
  const auto fail = [&](const std::string& fault) {
    throw std::runtime_error(source.substr(0, 100) + ":" + std::to_string(line) + ": " + fault);
  };
  for (size_t at = text.compare(0, 3, byte_order_mark) == 0 ? 3 : 0; at < text.size(); ++at) {
    const char c = text[at];
    if (c == '\n') {
      ++line;
      quote = 0;
    }
    if (quote) {
      if (c == '\\' && quote == '"') ++at;
      if (c == quote) quote = 0;
    } else if (c == '"' || c == '\'') {
      quote = c;
    } else if (c == '#') {
      at = std::min(text.find('\n', at), text.size()) - 1;
    } else if (c == '.') {
      if (++n_dots >= kMostParts)
        fail("a key of more than " + std::to_string(kMostParts) + " parts, expected one of the scene");
    } else if (std::string("=,{}[]\n").find(c) != std::string::npos) {
      n_dots = 0;
    } else if (static_cast<unsigned char>(c) > 127) {
      fail("a letter beyond ASCII, expected such in quotes on one line and in comments alone");
    }
  }
}

toml::table parse(const std::string& text, const std::string& source) {
  check_text(text, source);
  try {
    return toml::parse(text, source);
  } catch (const toml::parse_error& error) {
    throw std::runtime_error(source + ":" + std::to_string(error.source().begin.line) + ": " +
                             std::string(error.description()));
  }
}

/// `{ value = ... }` of the text in TOML, or of the text itself where it is none.
toml::table parse_override(const std::string& text, const std::string& source) {
  const auto as_text = [&] { return toml::parse("value = " + toml_text(text), source); };
  try {
    toml::table table = parse("value = " + text, source);
    return table.size() == 1 ? std::move(table) : as_text();
  } catch (const std::runtime_error&) {
    return as_text();
  }
}

/// Puts the value of "a.b.0.c=value" at its place, making tables on the way.
void apply_override(toml::table& root, const std::string& text) {
  const std::string source = "--set " + text;
  const size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0)
    throw std::runtime_error(source + ": expected key=value, e.g. material.nu=0.3");
  check_text(text.substr(0, equals), source);
  toml::table parsed = parse_override(text.substr(equals + 1), source);

  std::vector<std::string> keys;
  std::istringstream stream(text.substr(0, equals));
  for (std::string key; std::getline(stream, key, '.');) keys.push_back(key);
  const auto is_index = [](const std::string& key) {
    return !key.empty() && key.find_first_not_of("0123456789") == std::string::npos;
  };
  // Nodes are moved, not copied: a copy would lose the place named in error messages.
  toml::node* at = &root;
  std::string path;
  for (size_t i = 0; i < keys.size(); ++i) {
    const bool is_last = i + 1 == keys.size();
    path += (i ? "." : "") + keys[i];
    if (toml::array* array = at->as_array()) {
      size_t index = array->size();
      if (is_index(keys[i])) std::from_chars(keys[i].data(), keys[i].data() + keys[i].size(), index);
      if (index >= array->size())
        throw std::runtime_error(source + ": there is no " + path + ", the list has " +
                                 std::to_string(array->size()) + " elements");
      if (is_last)
        parsed.get("value")->visit(
            [&](auto& node) { array->replace(array->cbegin() + index, std::move(node)); });
      else
        at = array->get(index);
    } else if (toml::table* table = at->as_table()) {
      if (is_last)
        parsed.get("value")->visit([&](auto& node) { table->insert_or_assign(keys[i], std::move(node)); });
      else {
        toml::table made = parse(is_index(keys[i + 1]) ? "value = []" : "value = {}", source);
        made.get("value")->visit(
            [&](auto& node) { at = &table->insert(keys[i], std::move(node)).first->second; });
      }
    } else {
      throw std::runtime_error(source + ": there is no " + path + ", expected a key of the scene");
    }
  }
}

template <class Rows>
typename Rows::value_type interpolated(const Rows& rows, double t) {
  const auto after = std::upper_bound(rows.begin(), rows.end(), t,
                                      [](double time, const auto& row) { return time < row(0); });
  if (after == rows.begin()) return rows.front();
  if (after == rows.end()) return rows.back();
  const auto before = after - 1;
  return *before + (t - (*before)(0)) / ((*after)(0) - (*before)(0)) * (*after - *before);
}

}  // namespace

double value_at(const Curve& curve, double t) {
  return interpolated(curve, t)(1);
}

Eigen::Vector3d position_at(const Path& path, double t) {
  return interpolated(path, t).tail<3>();
}

double load_factor_of(const Scene& scene) {
  const auto& [strain, factor] = scene.load_scale;
  if (strain && !factor)
    throw std::runtime_error("load_scale.strain = " + toml_text(*strain) +
                             " without load_scale.factor: ./testbed run finds it");
  return factor.value_or(1);
}

std::optional<Eigen::Vector3d> gravity_of(const Scene& scene) {
  if (!scene.gravity) return {};
  return load_factor_of(scene) * *scene.gravity;
}

std::string large_strain_part(const Scene& scene) {
  if (!scene.obstacles.empty()) return "obstacles: bodies touch where they are, not where they were at rest";
  if (scene.self_contact.is_on) return "self_contact.on: a surface that touches itself has moved far";
  if (scene.skin) return "skin: it wrinkles, which turns it far";
  if (!scene.seams.empty()) return "seams: they turn with the parts that they tie";
  if (!scene.handles.empty()) return "handles: they pull the surface far";
  if (scene.volume) return "volume: it acts on the surface where that is, not where it was at rest";
  for (const Load& load : scene.loads)
    if (load.is_follower)
      return "a follower load: it acts on the surface where that is, not where it was at rest";
  if (!scene.supports.empty() && std::all_of(scene.supports.begin(), scene.supports.end(),
                                             [](const Support& s) { return s.end.has_value(); }))
    return "supports that all end: the body moves freely from then on";
  if (scene.collapse && scene.time.mode == TimeMode::Dynamic)
    return "collapse with time.mode = \"dynamic\": it goes on from where the body is";
  for (const InitialMotion& initial : scene.initial)
    if (!initial.spin.isZero(0) && scene.supports.empty())
      return "initial.spin without supports: the body turns far";
  return "";
}

MaterialLaw law_of(const Scene& scene) {
  if (scene.is_paper) return MaterialLaw::NeoHookean;  // full geometry
  if (scene.material.law) return *scene.material.law;
  return large_strain_part(scene).empty() ? MaterialLaw::SmallStrain : MaterialLaw::NeoHookean;
}

Eigen::Matrix3d stress_at(const std::vector<StressTerm>& terms, const Eigen::Vector3d& x) {
  Eigen::Matrix3d stress = Eigen::Matrix3d::Zero();
  for (const StressTerm& term : terms) {
    const auto s = term.tail<6>();
    const Eigen::Matrix3d tensor =
        (Eigen::Matrix3d() << s(0), s(5), s(4), s(5), s(1), s(3), s(4), s(3), s(2)).finished();
    stress += std::pow(x(0), term(0)) * std::pow(x(1), term(1)) * std::pow(x(2), term(2)) * tensor;
  }
  return stress;
}

int n_steps(const TimeOptions& time, double step) {
  const double n = std::max(1.0, std::ceil(time.end / step - 1e-9));  // the quotient may be rounded up
  constexpr int kMost = std::numeric_limits<int>::max();
  if (n <= kMost) return static_cast<int>(n);
  std::ostringstream what;
  what << "time.end = " << time.end << " s in steps of " << step << " s: " << n << " steps, expected at most "
       << kMost;
  throw std::runtime_error(what.str());
}

namespace {

/// The file's name, where it is text that may name a folder.
std::string default_name(const fs::path& file) {
  std::string stem = file.stem().string();
  try {
    const bool is_text = is_name(stem) && toml::parse("name = " + toml_text(stem)).contains("name");
    return is_text ? stem : "scene";
  } catch (const std::exception&) {  // not UTF-8
    return "scene";
  }
}

/// The scenes that events leave, one by one.
/// @param overrides  of the file, before them
void make_scenes_after(const fs::path& file, std::vector<std::string> overrides, Scene& scene) {
  overrides.emplace_back("events=[]");
  overrides.push_back("material.law=" + std::string(name_of(*scene.material.law)));
  for (size_t e = 0; e < scene.events.size(); ++e) {
    Event& event = scene.events[e];
    add_override(overrides, event.key, event.value);
    try {
      event.after = std::make_shared<const Scene>(read_scene(file, overrides));
    } catch (const std::runtime_error& error) {
      throw std::runtime_error(scene.places["events." + std::to_string(e) + ".key"] + ": " + error.what());
    }
  }
}

}  // namespace

void add_override(std::vector<std::string>& overrides, const std::string& key, const std::string& value) {
  const std::string begin = key + "=";
  overrides.erase(std::remove_if(overrides.begin(), overrides.end(),
                                 [&](const std::string& text) { return text.rfind(begin, 0) == 0; }),
                  overrides.end());
  overrides.push_back(begin + value);
}

Scene read_scene(const fs::path& file, const std::vector<std::string>& overrides) {
  constexpr std::uintmax_t kMost = 10000000;
  std::error_code absent;  // which reading tells
  if (const auto n = fs::file_size(file, absent); !absent && n > kMost)
    throw std::runtime_error(file.string() + ": " + std::to_string(n) + " bytes, expected at most " +
                             std::to_string(kMost) + " of a scene");
  toml::table table = parse(read_file(file), file.string());
  for (const std::string& text : overrides) apply_override(table, text);
  Scene scene;
  scene.name = default_name(file);
  Reader reader(table, "", scene.places);
  describe(reader, scene);
  reader.refuse_unknown_keys();
  scene.material.law = law_of(scene);
  make_scenes_after(file, overrides, scene);
  return scene;
}

}  // namespace testbed::meshing
