// PLY and STL, each as text or binary.
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <stdexcept>

#include "meshing/surface/surface_readers.h"

namespace testbed::meshing {

namespace {

struct PlyProperty {
  std::string name, type, count_type;  // count_type is empty unless the property is a list
};

struct PlyElement {
  std::string name;
  long count;
  std::vector<PlyProperty> properties;
};

/// The values of a PLY body one after the other, text or binary.
class PlyValues {
 public:
  PlyValues(std::string_view body, const std::string& format, const std::string& name)
      : body_(body),
        is_text_(format == "ascii"),
        is_big_endian_(format == "binary_big_endian"),
        name_(name) {}

  double next(const std::string& type) {
    if (is_text_) {
      constexpr std::string_view kBlanks = " \t\r\n\v\f";
      body_.remove_prefix(std::min(body_.find_first_not_of(kBlanks), body_.size()));
      const std::string_view token = body_.substr(0, body_.find_first_of(kBlanks));
      if (token.empty()) throw std::runtime_error(name_ + ": end of file, expected more values");
      body_.remove_prefix(token.size());
      const auto value = parse_double(token);
      if (!value) throw std::runtime_error(name_ + ": '" + shortened(token) + "', expected a number");
      return *value;
    }
    if (type == "char" || type == "int8") return binary<std::int8_t>();
    if (type == "uchar" || type == "uint8") return binary<std::uint8_t>();
    if (type == "short" || type == "int16") return binary<std::int16_t>();
    if (type == "ushort" || type == "uint16") return binary<std::uint16_t>();
    if (type == "int" || type == "int32") return binary<std::int32_t>();
    if (type == "uint" || type == "uint32") return binary<std::uint32_t>();
    if (type == "float" || type == "float32") return binary<float>();
    if (type == "double" || type == "float64") return binary<double>();
    throw std::runtime_error(name_ + ": property type '" + shortened(type) + "', expected one of PLY's");
  }

 private:
  template <class T>
  T binary() {
    if (body_.size() < sizeof(T)) throw std::runtime_error(name_ + ": end of file, expected more values");
    char bytes[sizeof(T)];
    body_.copy(bytes, sizeof(T));
    if (is_big_endian_) std::reverse(bytes, bytes + sizeof(T));
    body_.remove_prefix(sizeof(T));
    T value;
    std::memcpy(&value, bytes, sizeof(T));
    return value;
  }

  std::string_view body_;
  bool is_text_, is_big_endian_;
  std::string name_;
};

/// Shortest decimal digits that give x again.
std::string as_text(double x) {
  char digits[32];
  return {digits, std::to_chars(digits, digits + sizeof digits, x).ptr};
}

PolygonSoup read_binary_stl(std::string_view bytes, std::uint32_t n_triangles) {
  PolygonSoup soup;
  for (std::uint32_t f = 0; f < n_triangles; ++f) {
    float corners[9];
    std::memcpy(corners, bytes.data() + 84 + 50 * static_cast<size_t>(f) + 12, sizeof(corners));
    const int first = static_cast<int>(soup.points.size());
    for (int c = 0; c < 3; ++c)
      soup.points.emplace_back(corners[3 * c], corners[3 * c + 1], corners[3 * c + 2]);
    soup.triangles.emplace_back(first, first + 1, first + 2);
  }
  return soup;
}

PolygonSoup read_text_stl(std::string_view text, const std::string& name) {
  PolygonSoup soup;
  TextLines lines(text, name);
  int n_corners = 0;
  while (lines.next()) {
    const std::string_view keyword = lines.token();
    if (keyword == "facet") {
      n_corners = 0;
    } else if (keyword == "vertex") {
      const double x = lines.number(), y = lines.number(), z = lines.number();
      soup.points.emplace_back(x, y, z);
      ++n_corners;
    } else if (keyword == "endfacet") {
      if (n_corners != 3) lines.fail("facet with " + std::to_string(n_corners) + " corner(s), expected 3");
      const int end = static_cast<int>(soup.points.size());
      soup.triangles.emplace_back(end - 3, end - 2, end - 1);
    }
  }
  if (3 * soup.triangles.size() != soup.points.size()) lines.fail("end of file, expected endfacet");
  return soup;
}

}  // namespace

PolygonSoup read_ply(std::string_view bytes, const std::string& name) {
  const std::string_view end_of_header = "end_header";
  const size_t end = bytes.find(end_of_header);
  const size_t body = end == std::string_view::npos ? end : bytes.find('\n', end);
  if (bytes.substr(0, 3) != "ply" || body == std::string_view::npos)
    throw std::runtime_error(name + ": no PLY header, expected 'ply' to 'end_header'");

  TextLines header(bytes.substr(0, end), name);
  std::string format;
  std::vector<PlyElement> elements;
  while (header.next()) {
    const std::string_view keyword = header.token();
    if (keyword == "format") {
      format = header.token();
      if (format != "ascii" && format != "binary_little_endian" && format != "binary_big_endian")
        header.fail("format '" + shortened(format) +
                    "', expected ascii, binary_little_endian or binary_big_endian");
    } else if (keyword == "element") {
      const std::string element(header.token());
      elements.push_back({element, header.integer(), {}});
    } else if (keyword == "property") {
      if (elements.empty()) header.fail("property, expected an element before it");
      PlyProperty property;
      property.type = header.token();
      if (property.type == "list") {
        property.count_type = header.token();
        property.type = header.token();
      }
      property.name = header.token();
      elements.back().properties.push_back(property);
    }
  }

  for (const PlyElement& element : elements)
    if (element.count < 0 || (element.count > 0 && element.properties.empty()))
      throw std::runtime_error(
          name + ": element " + shortened(element.name) + " " + std::to_string(element.count) + " with " +
          std::to_string(element.properties.size()) + " properties, expected a count and a property");

  PolygonSoup soup;
  std::vector<std::vector<double>> faces;
  PlyValues values(bytes.substr(body + 1), format, name);
  for (const PlyElement& element : elements)
    for (long row = 0; row < element.count; ++row) {
      Eigen::Vector3d x = Eigen::Vector3d::Zero();
      for (const PlyProperty& property : element.properties) {
        const bool is_list = !property.count_type.empty();
        const double n = is_list ? values.next(property.count_type) : 1;
        if (!(n >= 0) || n != std::floor(n))
          throw std::runtime_error(name + ": " + shortened(element.name) + " " + std::to_string(row) +
                                   " has " + as_text(n) + " values of " + shortened(property.name) +
                                   ", expected a count");
        const bool is_face = is_list && element.name == "face" &&
                             (property.name == "vertex_indices" || property.name == "vertex_index");
        std::vector<double> corners;
        for (long c = 0; c < n; ++c) {
          const double value = values.next(property.type);
          if (is_face) corners.push_back(value);
          if (property.name.size() == 1 && property.name >= "x" && property.name <= "z")
            x[property.name[0] - 'x'] = value;
        }
        if (is_face) faces.push_back(corners);
      }
      if (element.name == "vertex") soup.points.push_back(x);
    }

  const int n_points = static_cast<int>(soup.points.size());
  for (size_t f = 0; f < faces.size(); ++f) {
    if (faces[f].size() < 3)
      throw std::runtime_error(name + ": face " + std::to_string(f) + " with " +
                               std::to_string(faces[f].size()) + " corner(s), expected at least 3");
    for (double v : faces[f])
      if (!(v >= 0 && v < n_points) || v != std::floor(v))
        throw std::runtime_error(name + ": face " + std::to_string(f) + " has vertex " + as_text(v) +
                                 ", expected a whole number from 0 to " + std::to_string(n_points - 1));
    soup.add_polygon({faces[f].begin(), faces[f].end()}, name);
  }
  return soup;
}

PolygonSoup read_stl(std::string_view bytes, const std::string& name) {
  // "solid" at the start proves nothing: many binary files have it in their header. The size does.
  std::uint32_t n_triangles = 0;
  if (bytes.size() >= 84) std::memcpy(&n_triangles, bytes.data() + 80, sizeof(n_triangles));
  const size_t binary_size = 84 + 50 * static_cast<size_t>(n_triangles);
  if (bytes.size() >= 84 && bytes.size() == binary_size) return read_binary_stl(bytes, n_triangles);
  if (bytes.substr(0, 1000).find("solid") != std::string_view::npos &&
      bytes.find('\0') == std::string_view::npos)
    return read_text_stl(bytes, name);
  throw std::runtime_error(name + ": " + std::to_string(bytes.size()) + " bytes, expected " +
                           (bytes.size() < 84 ? "an STL file"
                                              : std::to_string(binary_size) + " for " +
                                                    std::to_string(n_triangles) + " triangles"));
}

}  // namespace testbed::meshing
