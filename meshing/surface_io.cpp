#include "meshing/surface_io.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "meshing/files.h"

namespace testbed {
namespace {

/// Collects vertices and polygons and checks the indices at the end.
struct Builder {
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3i> triangles;

  void add_polygon(const std::vector<int>& corners) {
    for (size_t c = 2; c < corners.size(); ++c)
      triangles.emplace_back(corners[0], corners[c - 1], corners[c]);
  }

  SurfaceMesh mesh() const {
    SurfaceMesh surface;
    surface.X.resize(3, points.size());
    for (size_t i = 0; i < points.size(); ++i) surface.X.col(i) = points[i];
    surface.F.resize(3, triangles.size());
    for (size_t i = 0; i < triangles.size(); ++i) surface.F.col(i) = triangles[i];
    return surface;
  }
};

/// Words of a text file, line by line, with the place for error messages.
class Lines {
 public:
  Lines(const std::string& text, std::string name) : text_(text), name_(std::move(name)) {
    if (text_.compare(0, 3, "\xef\xbb\xbf") == 0) at_ = 3;
  }

  /// Next line with a word on it that is not behind `comment`; false at the end.
  bool next(char comment = '#') {
    while (at_ < text_.size()) {
      const size_t end = std::min(text_.find('\n', at_), text_.size());
      std::string line = text_.substr(at_, end - at_);
      at_ = end + 1;
      ++number_;
      line.erase(std::min(line.find(comment), line.size()));
      std::istringstream stream(line);
      words_.clear();
      for (std::string word; stream >> word;) words_.push_back(word);
      if (!words_.empty()) return true;
    }
    return false;
  }

  const std::vector<std::string>& words() const { return words_; }
  const std::string& word(size_t i, const char* expected) const {
    if (i >= words_.size()) fail("the line ends after " + std::to_string(words_.size()) + " words", expected);
    return words_[i];
  }
  double real(size_t i) const {
    const std::string& w = word(i, "a number");
    double value = 0;
    const char* begin = w.data() + (w[0] == '+');
    const auto [end, error] = std::from_chars(begin, w.data() + w.size(), value);
    if (error != std::errc() || end != w.data() + w.size()) fail("'" + w + "'", "a number");
    if (!std::isfinite(value)) fail("'" + w + "'", "a finite coordinate");
    return value;
  }
  long integer(size_t i) const { return to_integer(word(i, "an integer")); }
  long to_integer(const std::string& w) const {
    long value = 0;
    const auto [end, error] = std::from_chars(w.data(), w.data() + w.size(), value);
    if (error != std::errc() || end != w.data() + w.size()) fail("'" + w + "'", "an integer");
    return value;
  }
  Eigen::Vector3d point(size_t first) const { return {real(first), real(first + 1), real(first + 2)}; }
  int index(long value, size_t n_points) const {
    if (value < 0 || value >= static_cast<long>(n_points))
      fail("vertex index " + std::to_string(value),
           "0 to " + std::to_string(static_cast<long>(n_points) - 1));
    return static_cast<int>(value);
  }
  [[noreturn]] void fail(const std::string& found, const std::string& expected) const {
    throw std::runtime_error(name_ + ":" + std::to_string(number_) + ": found " + found + ", expected " +
                             expected);
  }
  [[noreturn]] void fail_at_end(const std::string& expected) const { fail("the end of the file", expected); }

 private:
  const std::string& text_;
  std::string name_;
  size_t at_ = 0;
  int number_ = 0;
  std::vector<std::string> words_;
};

SurfaceMesh read_obj(const std::string& text, const std::string& name) {
  Builder builder;
  Lines lines(text, name);
  std::vector<std::pair<std::vector<int>, int>> polygons;
  while (lines.next()) {
    const std::string& key = lines.words()[0];
    if (key == "v") {
      builder.points.push_back(lines.point(1));
    } else if (key == "f") {
      if (lines.words().size() < 4)
        lines.fail("a face of " + std::to_string(lines.words().size() - 1) + " corners", "at least 3");
      std::vector<int> corners;
      for (size_t c = 1; c < lines.words().size(); ++c) {
        const std::string& word = lines.words()[c];
        const long index = lines.to_integer(word.substr(0, word.find('/')));
        const long n = static_cast<long>(builder.points.size());
        if (index == 0 || index < -n || index > n)
          lines.fail(
              "vertex index " + std::to_string(index),
              "1 to " + std::to_string(n) + " or -1 to -" + std::to_string(n) + " (vertices read so far)");
        corners.push_back(static_cast<int>(index > 0 ? index - 1 : n + index));
      }
      builder.add_polygon(corners);
    }
  }
  return builder.mesh();
}

SurfaceMesh read_off(const std::string& text, const std::string& name) {
  Builder builder;
  Lines lines(text, name);
  if (!lines.next()) lines.fail_at_end("OFF");
  // The counts may follow on the same line, even glued to the word.
  std::string header;
  for (const std::string& word : lines.words()) header += " " + word;
  const size_t off = header.find("OFF");
  if (off == std::string::npos) lines.fail("'" + lines.words()[0] + "'", "OFF");
  std::istringstream counts_on_line(header.substr(off + 3));
  long n_points = -1, n_faces = -1;
  if (!(counts_on_line >> n_points >> n_faces)) {
    if (!lines.next()) lines.fail_at_end("the numbers of vertices and faces");
    n_points = lines.integer(0);
    n_faces = lines.integer(1);
  }
  if (n_points < 0 || n_faces < 0) lines.fail("a negative count", "numbers of vertices and faces");
  for (long i = 0; i < n_points; ++i) {
    if (!lines.next()) lines.fail_at_end(std::to_string(n_points) + " vertices, has " + std::to_string(i));
    builder.points.push_back(lines.point(0));
  }
  for (long i = 0; i < n_faces; ++i) {
    if (!lines.next()) lines.fail_at_end(std::to_string(n_faces) + " faces, has " + std::to_string(i));
    const long n_corners = lines.integer(0);
    if (n_corners < 3) lines.fail("a face of " + std::to_string(n_corners) + " corners", "at least 3");
    std::vector<int> corners;
    for (long c = 0; c < n_corners; ++c) corners.push_back(lines.index(lines.integer(1 + c), n_points));
    builder.add_polygon(corners);
  }
  return builder.mesh();
}

/// Reads numbers of the binary formats one after another, in the file's byte order.
class Bytes {
 public:
  Bytes(const std::string& data, size_t at, bool is_swapped, std::string name)
      : data_(data), at_(at), is_swapped_(is_swapped), name_(std::move(name)) {}

  template <typename T>
  T take() {
    if (at_ + sizeof(T) > data_.size())
      throw std::runtime_error(name_ + ": ends at byte " + std::to_string(data_.size()) +
                               " in the middle of a record, expected more data");
    std::array<char, sizeof(T)> bytes;
    std::memcpy(bytes.data(), data_.data() + at_, sizeof(T));
    if (is_swapped_) std::reverse(bytes.begin(), bytes.end());
    at_ += sizeof(T);
    T value;
    std::memcpy(&value, bytes.data(), sizeof(T));
    return value;
  }

  double take(const std::string& type) {
    if (type == "char" || type == "int8") return take<std::int8_t>();
    if (type == "uchar" || type == "uint8") return take<std::uint8_t>();
    if (type == "short" || type == "int16") return take<std::int16_t>();
    if (type == "ushort" || type == "uint16") return take<std::uint16_t>();
    if (type == "int" || type == "int32") return take<std::int32_t>();
    if (type == "uint" || type == "uint32") return take<std::uint32_t>();
    if (type == "float" || type == "float32") return take<float>();
    if (type == "double" || type == "float64") return take<double>();
    throw std::runtime_error(name_ + ": PLY type '" + type + "', expected one of char ... double");
  }

 private:
  const std::string& data_;
  size_t at_;
  bool is_swapped_;
  std::string name_;
};

struct PlyProperty {
  std::string name, type, count_type;  // count_type is empty unless the property is a list
};
struct PlyElement {
  std::string name;
  long count;
  std::vector<PlyProperty> properties;
};

SurfaceMesh read_ply(const std::string& text, const std::string& name) {
  Lines lines(text, name);
  std::string format;
  std::vector<PlyElement> elements;
  if (!lines.next('\0') || lines.words()[0] != "ply") lines.fail("another first line", "ply");
  while (true) {
    if (!lines.next('\0')) lines.fail_at_end("end_header");
    const std::string& key = lines.words()[0];
    if (key == "end_header") break;
    if (key == "format") format = lines.word(1, "a format");
    if (key == "element") elements.push_back({lines.word(1, "a name"), lines.integer(2), {}});
    if (key == "property") {
      if (elements.empty()) lines.fail("a property", "an element before it");
      if (lines.word(1, "a type") == "list")
        elements.back().properties.push_back(
            {lines.word(4, "a name"), lines.word(3, "a type"), lines.word(2, "a type")});
      else
        elements.back().properties.push_back({lines.word(2, "a name"), lines.words()[1], ""});
    }
  }
  if (format != "ascii" && format != "binary_little_endian" && format != "binary_big_endian")
    lines.fail("format '" + format + "'", "ascii, binary_little_endian or binary_big_endian");

  const size_t data = text.find('\n', text.find("end_header")) + 1;
  Bytes bytes(text, data, format == "binary_big_endian", name);
  size_t word = 0;
  const auto take = [&](const std::string& type) {
    if (format != "ascii") return bytes.take(type);
    while (word >= lines.words().size()) {
      if (!lines.next('\0')) lines.fail_at_end("more values");
      word = 0;
    }
    return lines.real(word++);
  };
  word = lines.words().size();

  Builder builder;
  for (const PlyElement& element : elements)
    for (long i = 0; i < element.count; ++i) {
      Eigen::Vector3d point(NAN, NAN, NAN);
      for (const PlyProperty& property : element.properties) {
        const long n = property.count_type.empty() ? 1 : static_cast<long>(take(property.count_type));
        std::vector<int> corners;
        for (long c = 0; c < n; ++c) {
          const double value = take(property.type);
          if (element.name == "vertex" && property.name.size() == 1 && property.name[0] >= 'x')
            point(property.name[0] - 'x') = value;
          if (property.name == "vertex_indices" || property.name == "vertex_index")
            corners.push_back(lines.index(static_cast<long>(value), builder.points.size()));
        }
        builder.add_polygon(corners);
      }
      if (element.name == "vertex") {
        if (!point.allFinite())
          throw std::runtime_error(name + ": vertex " + std::to_string(i) +
                                   " is not finite, expected x, y and z");
        builder.points.push_back(point);
      }
    }
  return builder.mesh();
}

SurfaceMesh read_stl(const std::string& text, const std::string& name) {
  std::vector<Eigen::Vector3d> corners;
  constexpr size_t kHeader = 84, kRecord = 50;
  std::uint32_t n_triangles = 0;
  if (text.size() >= kHeader) std::memcpy(&n_triangles, text.data() + 80, 4);
  const bool is_ascii = text.compare(0, 5, "solid") == 0 && text.size() != kHeader + kRecord * n_triangles &&
                        text.find("facet") != std::string::npos;
  if (is_ascii || text.size() < kHeader) {
    Lines lines(text, name);
    while (lines.next('\0'))
      if (lines.words()[0] == "vertex") corners.push_back(lines.point(1));
    if (corners.size() % 3 != 0)
      lines.fail_at_end("three vertices for every facet, has " + std::to_string(corners.size()) +
                        " vertices");
  } else {
    Bytes bytes(text, kHeader, false, name);
    for (std::uint32_t i = 0; i < n_triangles; ++i) {
      for (int k = 0; k < 3; ++k) bytes.take<float>();
      for (int c = 0; c < 3; ++c) {
        const float x = bytes.take<float>(), y = bytes.take<float>(), z = bytes.take<float>();
        corners.emplace_back(x, y, z);
        if (!corners.back().allFinite())
          throw std::runtime_error(name + ": triangle " + std::to_string(i) +
                                   " has a coordinate that is not finite");
      }
      bytes.take<std::uint16_t>();
    }
  }

  Builder builder;
  std::map<std::array<double, 3>, int> index_of;
  for (size_t c = 0; c < corners.size(); c += 3) {
    std::vector<int> triangle;
    for (size_t k = c; k < c + 3; ++k) {
      const Eigen::Vector3d& p = corners[k];
      const auto [at, is_new] = index_of.try_emplace({p.x(), p.y(), p.z()}, builder.points.size());
      if (is_new) builder.points.push_back(p);
      triangle.push_back(at->second);
    }
    builder.add_polygon(triangle);
  }
  return builder.mesh();
}

}  // namespace

SurfaceMesh read_surface(const std::filesystem::path& file) {
  const std::string text = read_file(file), name = file.string();
  std::string extension = file.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(), ::tolower);
  if (extension == ".obj") return read_obj(text, name);
  if (extension == ".off") return read_off(text, name);
  if (extension == ".ply") return read_ply(text, name);
  if (extension == ".stl") return read_stl(text, name);
  throw std::runtime_error(name + ": file type '" + extension + "', expected .obj, .off, .ply or .stl");
}

void write_off(const std::filesystem::path& file, const SurfaceMesh& surface) {
  std::ostringstream out;
  out.precision(17);
  out << "OFF\n" << surface.X.cols() << ' ' << surface.F.cols() << " 0\n";
  for (int i = 0; i < surface.X.cols(); ++i) out << surface.X.col(i).transpose() << '\n';
  for (int f = 0; f < surface.F.cols(); ++f) out << "3 " << surface.F.col(f).transpose() << '\n';
  write_file(file, out.str());
}

}  // namespace testbed
