#include <cassert>
#include <charconv>
#include <nlohmann/json.hpp>
#include <sstream>

#include "meshing/base/names.h"
#include "meshing/scene/scene_keys.h"

namespace testbed::meshing {

std::string toml_text(double x) {
  char buffer[32];
  const std::string text(buffer, std::to_chars(buffer, buffer + sizeof buffer, x).ptr);
  return text.find_first_of(".en") == std::string::npos ? text + ".0" : text;  // not 1e5, inf and nan
}

std::string toml_text(const std::string& text) {
  return nlohmann::json(text).dump();  // JSON escapes are TOML's
}

namespace {

/// Writes the scene's structs as TOML, each key with its meaning; what is absent as a comment.
class Writer {
 public:
  Writer(std::ostream& out, std::vector<SceneKey>& keys, std::string path)
      : out_(out), keys_(keys), path_(std::move(path)) {}

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
    line(key, text(value), meaning, true);
  }
  void path(const char* key, const std::string& value, const char* meaning) {
    line(key, value.empty() ? "" : toml_text(value), meaning);
  }
  template <class Enum>
  void choice(const char* key, Enum value, const char* meaning) {
    line(key, toml_text(name_of(value)), meaning);
  }
  template <class Enum>
  void choice(const char* key, const std::optional<Enum>& value, const char* meaning) {
    line(key, value ? toml_text(name_of(*value)) : "", meaning);
  }
  template <class T>
  void choice(const char* key, const T& value, const std::vector<std::string>&, const char* meaning) {
    line(key, value.empty() ? "" : text(value), meaning);
  }
  void components(const char* key, const std::array<bool, 3>& fixed, const char* meaning) {
    std::string letters;
    for (int c = 0; c < 3; ++c)
      if (fixed[c]) letters += "xyz"[c];
    line(key, toml_text(letters), meaning);
  }
  template <class T>
  void table(const char* key, T& value) {
    out_ << "\n[" << path_ << key << "]\n";
    Writer writer(out_, keys_, path_ + key + ".");
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
      Writer writer(out_, keys_, path_ + key + ".");
      describe(writer, value);
    }
  }
  template <class T>
  void inline_table(const char* key, T& value, const char* meaning) {
    line(key, in_braces(value), meaning);
  }
  template <class T, class Variant>
  void alternative(const char* key, Variant& shape) {
    if (T* value = std::get_if<T>(&shape)) line(key, in_braces(*value), "", true);
  }

  void check(const char*, bool, const char*) {}
  void at_most_one(const std::vector<const char*>&) {}
  void needs_alternative(const char*) {}

 private:
  void line(const char* key, const std::string& value, const std::string& meaning, bool is_chosen = false) {
    keys_.push_back({path_ + key, value, meaning, is_chosen});
    if (value.empty()) {
      assert(!is_inline_);
      out_ << "# " << key << ": " << meaning << '\n';
    } else if (is_inline_) {
      out_ << separator_ << key << " = " << value;
      separator_ = ", ";
    } else {
      out_ << key << " = " << value << (meaning.empty() ? "" : "  # " + meaning) << '\n';
    }
  }

  template <class T>
  static std::string in_braces(T& value) {
    std::ostringstream out;
    std::vector<SceneKey> inner;
    Writer writer(out, inner, "");
    writer.is_inline_ = true;
    describe(writer, value);
    return "{ " + out.str() + " }";
  }

  static std::string text(double x) { return toml_text(x); }
  static std::string text(bool x) { return x ? "true" : "false"; }
  static std::string text(int x) { return std::to_string(x); }
  static std::string text(std::uint64_t x) { return std::to_string(x); }
  static std::string text(const std::string& x) { return toml_text(x); }
  template <int n>
  static std::string text(const Eigen::Matrix<double, n, 1>& x) {
    return text(std::vector<double>(x.begin(), x.end()));
  }
  template <class T>
  static std::string text(const std::vector<T>& values) {
    std::vector<std::string> all;
    for (const T& value : values) all.push_back(text(value));
    return "[" + joined(all) + "]";
  }
  template <class T>
  static std::string text(const std::optional<T>& x) {
    return x ? text(*x) : "";
  }

  std::ostream& out_;
  std::vector<SceneKey>& keys_;
  std::string path_;
  bool is_inline_ = false;
  std::string separator_;
};

std::pair<std::string, std::vector<SceneKey>> written(Scene scene) {
  std::ostringstream out;
  std::vector<SceneKey> keys;
  Writer writer(out, keys, "");
  describe(writer, scene);  // the table of keys is shared with the reader, which needs to write
  return {out.str(), std::move(keys)};
}

}  // namespace

std::string to_toml(const Scene& scene) {
  return written(scene).first;
}

std::vector<SceneKey> keys_of(const Scene& scene) {
  return written(scene).second;
}

}  // namespace testbed::meshing
