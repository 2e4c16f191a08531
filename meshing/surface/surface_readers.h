// The readers behind read_surface, one per format; each takes the file's bytes and its name for messages.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "meshing/base/mesh.h"

namespace testbed::meshing {

/// Points and polygons as they stand in a file, cut into triangles.
class PolygonSoup {
 public:
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3i> triangles;

  /// Cuts a polygon of existing points into triangles without
  /// leaving its outline, also where it is not convex.
  /// @param name  of the file
  /// @throws std::runtime_error where all of the file's take too long: outlines that cross themselves take the cube of
  /// their corners
  void add_polygon(const std::vector<int>& corners, const std::string& name);

 private:
  long n_looks_ = 0;  ///< at corners, whether they lie in an ear
};

/// Walks over the lines of a text: CRLF, byte-order mark and
/// comments (from '#') are taken off, blank lines skipped.
class TextLines {
 public:
  TextLines(std::string_view text, std::string name);

  /// Goes to the next line that holds something; false at the end.
  bool next();
  /// Next token of the line by blanks; empty at its end.
  std::string_view token();
  std::string_view rest() const { return line_; }
  double number();  ///< of the next token; must be finite
  long integer();
  int line_number() const { return number_; }
  /// @throws std::runtime_error "name:line: message"
  [[noreturn]] void fail(const std::string& message) const;

 private:
  std::string_view text_, line_;
  std::string name_;
  int number_ = 0;
};

/// For messages: without what makes it long.
std::string shortened(std::string_view found);

/// The number that fills the token, independent of the locale.
std::optional<double> parse_double(std::string_view token);
std::optional<long> parse_integer(std::string_view token);

PolygonSoup read_obj(std::string_view text, const std::string& name);
PolygonSoup read_off(std::string_view text, const std::string& name);
PolygonSoup read_ply(std::string_view bytes, const std::string& name);
PolygonSoup read_stl(std::string_view bytes, const std::string& name);

}  // namespace testbed::meshing
