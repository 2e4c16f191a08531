#include "meshing/scene.h"

#define TOML_HEADER_ONLY 1
#include <toml++/toml.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <functional>
#include <sstream>
#include <stdexcept>

#include "meshing/files.h"
#include "meshing/names.h"
#include "meshing/record.h"
#include "meshing/shapes.h"
#include "meshing/surface.h"
#include "meshing/surface_io.h"

namespace testbed {
namespace {

/// What a number may be, in words and as a test.
struct Range {
  const char* expected;
  bool (*holds)(double);
};
const Range kAny{"a number", [](double) { return true; }};
const Range kPositive{"> 0", [](double x) { return x > 0; }};
const Range kNotNegative{">= 0", [](double x) { return x >= 0; }};
const Range kPoisson{"in (-1, 0.5)", [](double x) { return x > -1 && x < 0.5; }};
const Range kFraction{"in [0, 1)", [](double x) { return x >= 0 && x < 1; }};
const Range kAtLeastOne{">= 1", [](double x) { return x >= 1; }};
const Range kAtLeastThree{">= 3", [](double x) { return x >= 3; }};
const Range kDegree{"1 or 2", [](double x) { return x == 1 || x == 2; }};

const std::vector<std::string> kTimeModes{"static", "dynamic"};
const std::vector<std::string> kIntegrators{"explicit_euler", "symplectic_euler", "implicit_euler"};

// The scene file's one table: key, place, what is allowed, meaning. Reader and Writer below both walk it.

template <class V>
void describe(V& v, Everywhere&) {}

template <class V>
void describe(V& v, Box& box) {
  v.required("low", box.low, kAny, "corner (m)");
  v.required("high", box.high, kAny, "opposite corner (m)");
}

template <class V>
void describe(V& v, HalfSpace& half) {
  v.required("point", half.point, kAny, "on the plane (m)");
  v.required("normal", half.normal, kAny, "out of the half space");
}

template <class V>
void describe(V& v, Ball& ball) {
  v.required("center", ball.centre, kAny, "m");
  v.required("radius", ball.radius, kPositive, "m");
}

template <class V>
void describe(V& v, Region& region) {
  v.template alternative<Box>("box", region.shape);
  v.template alternative<HalfSpace>("plane", region.shape);
  v.template alternative<Ball>("sphere", region.shape);
  v("relative", region.relative, "in fractions of the bounding box");
}

template <class V>
void describe(V& v, SurfaceSource& s) {
  v.path("file", s.file, "closed surface: .obj .off .ply .stl, relative to this file");
  v("shape", s.shape, "or a generated one: ball, torus, bar, handle, head");
  v("n_vertices", s.n_vertices, kAtLeastOne, "of a generated shape, about");
  v("size", s.size, kNotNegative, "bounding box of a generated shape (m), 0: its own");
  v("scale", s.scale, kPositive, "factor on all coordinates");
  v("normalise", s.normalise, "scale so that the bounding box's smallest side is 1 m, centre at the origin");
}

template <class V>
void describe(V& v, Material& m) {
  v("E", m.E, kPositive, "Young's modulus (Pa)");
  v("nu", m.nu, kPoisson, "Poisson's ratio");
  v("rho", m.rho, kPositive, "density (kg/m3)");
  v("damping", m.damping, kNotNegative, "mass-proportional damping (1/s)");
}

template <class V>
void describe(V& v, Support& s) {
  v.inline_table("region", s.region, "which surface nodes");
  v.components("components", s.fixed, "prescribed components");
  v("displacement", s.displacement, kAny, "theirs at full load (m)");
}

template <class V>
void describe(V& v, Load& l) {
  v.inline_table("region", l.region, "triangles with three nodes inside");
  v("pressure", l.pressure, kAny, "against the outward normal (Pa)");
  v("traction", l.traction, kAny, "Pa");
}

template <class V>
void describe(V& v, Pivot& p) {
  v.required("point", p.point, kAny, "m");
  v("start", p.start, kNotNegative, "s; static scenes: load factor");
}

template <class V>
void describe(V& v, Collapse& c) {
  v("coefficient", c.coefficient, kFraction, "depletion R of rest lengths");
  v.list("pivots", c.pivots);
}

template <class V>
void describe(V& v, Obstacle& o) {
  v.template alternative<HalfSpace>("plane", o.shape);
  v.template alternative<Ball>("sphere", o.shape);
}

template <class V>
void describe(V& v, TimeOptions& t) {
  v.choice("mode", t.mode, kTimeModes, "static (loads grow in load_steps) or dynamic");
  v("load_steps", t.load_steps, kAtLeastOne, "static: steps to full load");
  v("step", t.step, kNotNegative, "dynamic: s; 0 chooses one");
  v("end", t.end, kPositive, "dynamic: s");
  v.choice("integrator", t.integrator, kIntegrators,
           "dynamic: explicit_euler, symplectic_euler, implicit_euler");
}

template <class V>
void describe(V& v, NetworkOptions& n) {
  v("phi", n.phi, kPositive, "least distance of internal nodes (normalised box); absent: from the surface");
  v("psi", n.psi, kPositive, "least distance to the surface (normalised box); absent: from the surface");
  v("k", n.k, kNotNegative, "internal nodes wanted; absent: as many as fit");
  v("multiplicity", n.multiplicity, kAtLeastThree, "springs projected by each white node");
  v("seed", n.seed, "of the random nodes");
  v("calibration", n.calibration, "name of the spring model");
}

template <class V>
void describe(V& v, ReferenceOptions& r) {
  v("degree", r.degree, kDegree, "of the displacement's polynomials");
  v("interior_size", r.interior_size, kPositive, "edge length inside (m); absent: from the surface");
  v("refine", r.refine, kNotNegative, "times every tetrahedron is split in eight");
}

template <class V>
void describe(V& v, ComparisonOptions& c) {
  v("calibrations", c.calibrations, "spring models run beside network.calibration");
}

template <class V>
void describe(V& v, OutputOptions& o) {
  v("frames_every", o.frames_every, kNotNegative, "steps between frames; 0: only the last");
  v("curves", o.curves, "write curves.csv");
  v("fields", o.fields, "in the frames: displacement, velocity");
}

template <class V>
void describe(V& v, Scene& s) {
  v("name", s.name, "of the output folder");
  v("gravity", s.gravity, kAny, "m/s2");
  v.table("surface", s.surface);
  v.table("material", s.material);
  v.list("supports", s.supports);
  v.list("loads", s.loads);
  v.table("collapse", s.collapse);
  v.list("obstacles", s.obstacles);
  v.table("time", s.time);
  v.table("network", s.network);
  v.table("reference", s.reference);
  v.table("comparison", s.comparison);
  v.table("output", s.output);
}

std::string text_of(double x) {
  char buffer[32];
  const auto end = std::to_chars(buffer, buffer + sizeof buffer, x).ptr;
  std::string text(buffer, end);
  return text.find_first_of(".e") == std::string::npos ? text + ".0" : text;
}

std::string in_quotes(const std::string& text) {
  return (std::ostringstream() << toml::value<std::string>(text)).str();
}

/// Fills the scene's structs from a TOML table and refuses every key it was not asked for.
class Reader {
 public:
  Reader(const toml::table& table, std::string path) : table_(table), path_(std::move(path)) {}

  template <class T>
  void operator()(const char* key, T& value, const Range& range, const char*) {
    if (const toml::node* node = find(key)) read(*node, key, value, range);
  }
  template <class T>
  void operator()(const char* key, T& value, const char* meaning) {
    (*this)(key, value, kAny, meaning);
  }
  template <class T>
  void required(const char* key, T& value, const Range& range, const char* meaning) {
    (*this)(key, value, range, meaning);
    if (!table_.contains(key)) fail(table_, path_ + key + " is missing");
  }
  void path(const char* key, std::string& value, const char* meaning) {
    (*this)(key, value, meaning);
    if (value.empty()) return;
    const std::string source = source_of(*table_.get(key));
    const std::filesystem::path base =
        is_override(source) ? std::filesystem::current_path() : std::filesystem::path(source).parent_path();
    value = std::filesystem::absolute(base / value).lexically_normal().string();
  }
  template <class E>
  void choice(const char* key, E& value, const std::vector<std::string>& names, const char*) {
    const toml::node* node = find(key);
    if (!node) return;
    std::string name;
    read(*node, key, name, kAny);
    const auto at = std::find(names.begin(), names.end(), name);
    if (at == names.end())
      fail(*node, path_ + key + " = " + in_quotes(name) + ", expected one of " + joined(names));
    value = static_cast<E>(at - names.begin());
  }
  void components(const char* key, std::array<bool, 3>& fixed, const char*) {
    const toml::node* node = find(key);
    if (!node) return;
    std::string letters;
    read(*node, key, letters, kAny);
    if (letters.empty() || letters.find_first_not_of("xyz") != std::string::npos)
      fail(*node, path_ + key + " = " + in_quotes(letters) + ", expected letters of \"xyz\"");
    for (int c = 0; c < 3; ++c) fixed[c] = letters.find("xyz"[c]) != std::string::npos;
  }
  template <class T>
  void table(const char* key, T& value) {
    if (const toml::node* node = find(key)) read_table(*node, path_ + key, value);
  }
  template <class T>
  void table(const char* key, std::optional<T>& value) {
    if (const toml::node* node = find(key)) read_table(*node, path_ + key, value.emplace());
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
    if (!array) fail(*node, path_ + key + " is a " + type_of(*node) + ", expected [[" + path_ + key + "]]");
    for (size_t i = 0; i < array->size(); ++i)
      read_table((*array)[i], path_ + key + "." + std::to_string(i), values.emplace_back());
  }
  template <class T, class Variant>
  void alternative(const char* key, Variant& shape) {
    const toml::node* node = find(key);
    if (!node) return;
    if (!chosen_.empty())
      fail(*node, path_ + " has both " + chosen_ + " and " + key + ", expected one of them");
    chosen_ = key;
    T value;
    read_table(*node, path_ + key, value);
    shape = value;
  }

  void refuse_unknown_keys() const {
    for (const auto& [key, node] : table_) {
      const std::string name(key.str());
      if (std::find(known_.begin(), known_.end(), name) != known_.end()) continue;
      fail(node, path_ + name + ": unknown key" + suggestion(name, known_));
    }
  }

  [[noreturn]] static void fail(const toml::node& node, const std::string& what) {
    const std::string source = source_of(node);
    const std::string line = is_override(source) ? "" : ":" + std::to_string(node.source().begin.line);
    throw std::runtime_error(source + line + ": " + what);
  }

 private:
  static std::string source_of(const toml::node& node) {
    return node.source().path ? *node.source().path : "--set";
  }
  static bool is_override(const std::string& source) { return source.rfind("--set", 0) == 0; }

  const toml::node* find(const char* key) {
    known_.emplace_back(key);
    return table_.get(key);
  }

  static std::string type_of(const toml::node& node) { return (std::ostringstream() << node.type()).str(); }

  static std::string value_of(const toml::node& node) {
    std::ostringstream out;
    if (const auto* number = node.as_floating_point()) return text_of(number->get());
    node.visit([&](const auto& value) { out << value; });
    return out.str();
  }

  template <class T>
  void read_table(const toml::node& node, const std::string& path, T& value) {
    const toml::table* table = node.as_table();
    if (!table) fail(node, path + " is a " + type_of(node) + ", expected a table");
    Reader reader(*table, path + ".");
    describe(reader, value);
    reader.refuse_unknown_keys();
  }

  [[noreturn]] void wrong(const toml::node& node, const char* key, const std::string& expected) const {
    fail(node, path_ + key + " = " + value_of(node) + ", expected " + expected);
  }

  template <class T>
  void read(const toml::node& node, const char* key, T& value, const Range& range) const {
    if constexpr (std::is_same_v<T, double>) {
      const auto number = node.value<double>();
      if (!number || node.is_boolean() || !std::isfinite(*number)) wrong(node, key, "a number");
      if (!range.holds(*number)) wrong(node, key, range.expected);
      value = *number;
    } else if constexpr (std::is_same_v<T, bool>) {
      if (!node.is_boolean()) wrong(node, key, "true or false");
      value = *node.value<bool>();
    } else if constexpr (std::is_integral_v<T>) {
      const auto* number = node.as_integer();
      if (!number) wrong(node, key, "an integer");
      if (number->get() < 0 && std::is_unsigned_v<T>) wrong(node, key, ">= 0");
      if (number->get() > std::numeric_limits<int>::max() && sizeof(T) == sizeof(int))
        wrong(node, key, "below 2^31");
      if (!range.holds(static_cast<double>(number->get()))) wrong(node, key, range.expected);
      value = static_cast<T>(number->get());
    } else if constexpr (std::is_same_v<T, std::string>) {
      if (!node.is_string()) wrong(node, key, "a string in quotes");
      value = *node.value<std::string>();
    } else if constexpr (std::is_same_v<T, Eigen::Vector3d>) {
      const toml::array* array = node.as_array();
      if (!array || array->size() != 3) wrong(node, key, "three numbers [x, y, z]");
      for (int c = 0; c < 3; ++c) read((*array)[c], key, value(c), range);
    } else if constexpr (std::is_same_v<T, std::vector<std::string>>) {
      const toml::array* array = node.as_array();
      if (!array) wrong(node, key, "a list of strings");
      value.resize(array->size());
      for (size_t i = 0; i < array->size(); ++i) read((*array)[i], key, value[i], range);
    } else {  // std::optional
      read(node, key, value.emplace(), range);
    }
  }

  const toml::table& table_;
  std::string path_;
  std::vector<std::string> known_;
  std::string chosen_;
};

/// Writes the scene's structs as TOML, each key with its meaning.
class Writer {
 public:
  Writer(std::ostream& out, std::string path) : out_(out), path_(std::move(path)) {}

  template <class T>
  void operator()(const char* key, const T& value, const Range&, const char* meaning) {
    line(key, text(value), meaning);
  }
  template <class T>
  void operator()(const char* key, const T& value, const char* meaning) {
    line(key, text(value), meaning);
  }
  template <class T>
  void required(const char* key, const T& value, const Range&, const char* meaning) {
    line(key, text(value), meaning);
  }
  void path(const char* key, const std::string& value, const char* meaning) {
    line(key, in_quotes(value), meaning);
  }
  template <class E>
  void choice(const char* key, E value, const std::vector<std::string>& names, const char* meaning) {
    line(key, in_quotes(names[static_cast<size_t>(value)]), meaning);
  }
  void components(const char* key, const std::array<bool, 3>& fixed, const char* meaning) {
    std::string letters;
    for (int c = 0; c < 3; ++c)
      if (fixed[c]) letters += "xyz"[c];
    line(key, in_quotes(letters), meaning);
  }
  template <class T>
  void table(const char* key, T& value) {
    out_ << "\n[" << path_ << key << "]\n";
    Writer writer(out_, path_ + key + ".");
    describe(writer, value);
  }
  template <class T>
  void table(const char* key, std::optional<T>& value) {
    if (value) table(key, *value);
  }
  template <class T>
  void list(const char* key, std::vector<T>& values) {
    for (T& value : values) {
      out_ << "\n[[" << path_ << key << "]]\n";
      Writer writer(out_, path_ + key + ".");
      describe(writer, value);
    }
  }
  template <class T>
  void inline_table(const char* key, T& value, const char* meaning) {
    line(key, in_braces(value), meaning);
  }
  template <class T, class Variant>
  void alternative(const char* key, Variant& shape) {
    if (T* value = std::get_if<T>(&shape)) line(key, in_braces(*value), "");
  }

 private:
  void line(const char* key, const std::string& value, const std::string& meaning) {
    if (value.empty()) return;
    if (is_inline_) {
      out_ << separator_ << key << " = " << value;
      separator_ = ", ";
    } else {
      out_ << key << " = " << value << (meaning.empty() ? "" : "  # " + meaning) << '\n';
    }
  }

  template <class T>
  static std::string in_braces(T& value) {
    std::ostringstream out;
    Writer writer(out, "");
    writer.is_inline_ = true;
    describe(writer, value);
    return "{ " + out.str() + " }";
  }

  static std::string text(double x) { return text_of(x); }
  static std::string text(bool x) { return x ? "true" : "false"; }
  static std::string text(int x) { return std::to_string(x); }
  static std::string text(std::uint64_t x) { return std::to_string(x); }
  static std::string text(const std::string& x) { return in_quotes(x); }
  static std::string text(const Eigen::Vector3d& x) {
    return "[" + text_of(x(0)) + ", " + text_of(x(1)) + ", " + text_of(x(2)) + "]";
  }
  static std::string text(const std::vector<std::string>& words) {
    std::vector<std::string> all;
    for (const std::string& word : words) all.push_back(in_quotes(word));
    return "[" + joined(all) + "]";
  }
  template <class T>
  static std::string text(const std::optional<T>& x) {
    return x ? text(*x) : "";
  }

  std::ostream& out_;
  std::string path_;
  bool is_inline_ = false;
  std::string separator_;
};

toml::table parse(const std::string& text, const std::string& source) {
  try {
    return toml::parse(text, source);
  } catch (const toml::parse_error& error) {
    throw std::runtime_error(source + ":" + std::to_string(error.source().begin.line) + ": " +
                             std::string(error.description()));
  }
}

/// Puts the value of "a.b.0.c=value" at its place in the table, making tables on the way.
void apply_override(toml::table& root, const std::string& text) {
  const std::string source = "--set " + text;
  const size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0)
    throw std::runtime_error(source + ": expected key=value, e.g. material.nu=0.3");
  const std::string value = text.substr(equals + 1);
  const bool is_word = !value.empty() && std::isalpha(value[0]) + (value[0] == '/') + (value[0] == '.') &&
                       value != "true" && value != "false" && value != "inf" && value != "nan";
  toml::table parsed = parse("value = " + (is_word ? in_quotes(value) : value), source);

  std::vector<std::string> keys;
  std::istringstream stream(text.substr(0, equals));
  for (std::string key; std::getline(stream, key, '.');) keys.push_back(key);
  toml::node* at = &root;
  for (size_t i = 0; i < keys.size(); ++i) {
    const bool is_last = i + 1 == keys.size();
    if (toml::array* array = at->as_array()) {
      size_t index = 0;
      const auto [end, error] = std::from_chars(keys[i].data(), keys[i].data() + keys[i].size(), index);
      if (error != std::errc() || end != keys[i].data() + keys[i].size() || index >= array->size() || is_last)
        throw std::runtime_error(source + ": '" + keys[i] + "', expected a key behind an index below " +
                                 std::to_string(array->size()));
      at = array->get(index);
    } else if (toml::table* table = at->as_table()) {
      if (is_last) {
        // Moved, not copied: a copy would lose the place named in error messages.
        parsed.get("value")->visit([&](auto& node) { table->insert_or_assign(keys[i], std::move(node)); });
      } else {
        at = &table->insert(keys[i], toml::table{}).first->second;
      }
    } else {
      throw std::runtime_error(source + ": '" + keys[i - 1] + "' is no table");
    }
  }
}

void check(const Scene& scene, const std::string& source) {
  if (scene.surface.file.empty() == scene.surface.shape.empty())
    throw std::runtime_error(source + ": surface." +
                             (scene.surface.file.empty() ? "file and surface.shape are both missing"
                                                         : "file and surface.shape are both given") +
                             ", expected one of them");
}

bool is_inside(const Everywhere&, const Eigen::Vector3d&, double) {
  return true;
}
bool is_inside(const Box& box, const Eigen::Vector3d& x, double slack) {
  return ((x - box.low).array() >= -slack).all() && ((box.high - x).array() >= -slack).all();
}
bool is_inside(const HalfSpace& half, const Eigen::Vector3d& x, double slack) {
  return (x - half.point).dot(half.normal.normalized()) <= slack;
}
bool is_inside(const Ball& ball, const Eigen::Vector3d& x, double slack) {
  return (x - ball.centre).norm() <= ball.radius + slack;
}

using Shape = decltype(Region::shape);

Shape absolute(const Everywhere& everywhere, const Eigen::Vector3d&, const Eigen::Vector3d&) {
  return everywhere;
}
Shape absolute(const Box& box, const Eigen::Vector3d& low, const Eigen::Vector3d& extent) {
  return Box{low + extent.cwiseProduct(box.low), low + extent.cwiseProduct(box.high)};
}
Shape absolute(const HalfSpace& half, const Eigen::Vector3d& low, const Eigen::Vector3d& extent) {
  return HalfSpace{low + extent.cwiseProduct(half.point), half.normal};
}
Shape absolute(const Ball& ball, const Eigen::Vector3d& low, const Eigen::Vector3d& extent) {
  return Ball{low + extent.cwiseProduct(ball.centre), ball.radius * extent.minCoeff()};
}

std::vector<bool> membership(const Region& region, const SurfaceMesh& surface) {
  const Eigen::Vector3d low = surface.X.rowwise().minCoeff();
  const Eigen::Vector3d extent = surface.X.rowwise().maxCoeff() - low;
  const auto shape =
      region.relative
          ? std::visit([&](const auto& s) -> Shape { return absolute(s, low, extent); }, region.shape)
          : region.shape;
  constexpr double kSlack = 1e-9;  // of the bounding box: a vertex placed on the region's boundary is inside
  std::vector<bool> is_member(surface.X.cols());
  for (int i = 0; i < surface.X.cols(); ++i)
    is_member[i] = std::visit(
        [&](const auto& s) { return is_inside(s, surface.X.col(i), kSlack * extent.norm()); }, shape);
  return is_member;
}

}  // namespace

Scene read_scene(const std::filesystem::path& file, const std::vector<std::string>& overrides) {
  toml::table table = parse(read_file(file), file.string());
  for (const std::string& text : overrides) apply_override(table, text);
  Scene scene;
  scene.name = file.stem().string();
  Reader reader(table, "");
  describe(reader, scene);
  reader.refuse_unknown_keys();
  check(scene, file.string());
  return scene;
}

std::string to_toml(const Scene& scene) {
  std::ostringstream out;
  Writer writer(out, "");
  Scene copy = scene;  // the table of keys is shared with the reader, which needs to write
  describe(writer, copy);
  return out.str();
}

SurfaceMesh load_surface(const SurfaceSource& source) {
  SurfaceMesh surface = source.file.empty() ? make_shape(source.shape, source.n_vertices, source.size)
                                            : read_surface(source.file);
  check_closed(surface, source.file.empty() ? source.shape : source.file);
  surface.X *= source.scale;
  if (source.normalise) {
    const Eigen::Vector3d low = surface.X.rowwise().minCoeff(), high = surface.X.rowwise().maxCoeff();
    surface.X.colwise() -= (low + high) / 2;
    surface.X /= (high - low).minCoeff();
  }
  return surface;
}

std::string input_hash(const Scene& scene, const SurfaceMesh& surface,
                       const std::vector<std::string>& ignored) {
  toml::table table = toml::parse(to_toml(scene));
  table.erase("name");
  for (const std::string& key : ignored) table.erase(key);
  std::ostringstream bytes;
  bytes << table;
  bytes.write(reinterpret_cast<const char*>(surface.X.data()), surface.X.size() * sizeof(double));
  bytes.write(reinterpret_cast<const char*>(surface.F.data()), surface.F.size() * sizeof(int));
  bytes << program_hash();
  return hash_of(bytes.str());
}

std::vector<int> vertices_in(const Region& region, const SurfaceMesh& surface) {
  const std::vector<bool> is_member = membership(region, surface);
  std::vector<int> vertices;
  for (int i = 0; i < surface.X.cols(); ++i)
    if (is_member[i]) vertices.push_back(i);
  return vertices;
}

std::vector<int> triangles_in(const Region& region, const SurfaceMesh& surface) {
  const std::vector<bool> is_member = membership(region, surface);
  std::vector<int> triangles;
  for (int f = 0; f < surface.F.cols(); ++f)
    if (is_member[surface.F(0, f)] && is_member[surface.F(1, f)] && is_member[surface.F(2, f)])
      triangles.push_back(f);
  return triangles;
}

}  // namespace testbed
