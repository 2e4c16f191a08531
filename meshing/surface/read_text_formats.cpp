// OBJ and OFF.
#include <Eigen/Geometry>
#include <algorithm>
#include <cctype>

#include "meshing/surface/surface_readers.h"

namespace testbed::meshing {

void PolygonSoup::add_polygon(const std::vector<int>& corners, const std::string& name) {
  constexpr long kMostLooks = 200'000'000;
  std::vector<int> left = corners;
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // of the whole outline (Newell)
  for (size_t c = 0; c < corners.size(); ++c)
    normal += (points[corners[c]] - points[corners[0]])
                  .cross(points[corners[(c + 1) % corners.size()]] - points[corners[0]]);
  auto corner = [&](size_t c) -> const Eigen::Vector3d& { return points[left[c % left.size()]]; };
  auto turn = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
    return (b - a).cross(c - b).dot(normal);
  };
  auto is_ear = [&](size_t c) {
    const size_t n = left.size();
    const Eigen::Vector3d &p = corner(c + n - 1), &q = corner(c), &r = corner(c + 1);
    if (turn(p, q, r) <= 0) return false;
    for (size_t o = c + 2; o < c + n - 1; ++o) {
      ++n_looks_;
      const Eigen::Vector3d& x = corner(o);
      if (turn(p, q, x) >= 0 && turn(q, r, x) >= 0 && turn(r, p, x) >= 0) return false;
    }
    return true;
  };
  while (left.size() > 3) {
    size_t ear = 1;  // where none is found the outline is degenerate: cut a fan
    for (size_t c = 1; c <= left.size(); ++c)
      if (is_ear(c)) {
        ear = c % left.size();
        break;
      }
    if (n_looks_ > kMostLooks)
      throw std::runtime_error(name + ": a face of " + std::to_string(corners.size()) +
                               " corners takes too long to be cut, expected fewer");
    const size_t n = left.size();
    triangles.emplace_back(left[(ear + n - 1) % n], left[ear], left[(ear + 1) % n]);
    left.erase(left.begin() + ear);
  }
  triangles.emplace_back(left[0], left[1], left[2]);
}

PolygonSoup read_obj(std::string_view text, const std::string& name) {
  PolygonSoup soup;
  struct Face {
    std::vector<long> corners;
    int line;
  };
  std::vector<Face> faces;
  TextLines lines(text, name);
  while (lines.next()) {
    const std::string_view keyword = lines.token();
    if (keyword == "v") {
      const double x = lines.number(), y = lines.number(), z = lines.number();  // colours may follow
      soup.points.emplace_back(x, y, z);
    } else if (keyword == "f") {
      Face face{{}, lines.line_number()};
      for (std::string_view token = lines.token(); !token.empty(); token = lines.token()) {
        if (token == "\\") {  // the line goes on in the next
          if (!lines.next()) break;
          continue;
        }
        const long i =
            parse_integer(token.substr(0, token.find('/'))).value_or(0);  // v, v/vt, v//vn, v/vt/vn
        if (i == 0) lines.fail("corner '" + shortened(token) + "', expected a vertex number");
        face.corners.push_back(i > 0 ? i - 1 : static_cast<long>(soup.points.size()) + i);
      }
      if (face.corners.size() < 3)
        lines.fail("face with " + std::to_string(face.corners.size()) + " corner(s), expected at least 3");
      faces.push_back(std::move(face));
    }
  }
  for (const Face& face : faces) {
    for (long v : face.corners)
      if (v < 0 || v >= static_cast<long>(soup.points.size()))
        throw std::runtime_error(name + ":" + std::to_string(face.line) + ": vertex " +
                                 std::to_string(v + 1) + ", expected 1 to " +
                                 std::to_string(soup.points.size()));
    soup.add_polygon({face.corners.begin(), face.corners.end()}, name);
  }
  return soup;
}

PolygonSoup read_off(std::string_view text, const std::string& name) {
  PolygonSoup soup;
  TextLines lines(text, name);
  auto next_line = [&](const std::string& wanted) {
    if (!lines.next()) lines.fail("end of file, expected " + wanted);
  };
  // [ST][C][N]OFF, then the counts, perhaps without a blank between or on the next line
  next_line("OFF");
  std::string_view header = lines.token();
  const size_t off = header.find("OFF");
  if (off == std::string_view::npos ||
      header.substr(0, off).find_first_not_of("STCN") != std::string_view::npos)
    lines.fail("'" + shortened(header) + "', expected OFF");
  std::string counts = std::string(header.substr(off + 3)) + std::string(lines.rest());
  if (counts.find_first_not_of(" \t") == std::string::npos) {
    next_line("the counts of vertices and faces");
    counts = lines.rest();
  }
  TextLines count_line(counts, name + ":" + std::to_string(lines.line_number()));
  count_line.next();
  const long n_vertices = count_line.integer(), n_faces = count_line.integer();
  if (n_vertices < 0 || n_faces < 0)
    lines.fail("'" + shortened(counts) + "', expected the counts of vertices and faces");

  for (long i = 0; i < n_vertices; ++i) {
    next_line("vertex " + std::to_string(i) + " of " + std::to_string(n_vertices));
    const double x = lines.number(), y = lines.number(), z = lines.number();  // normals, colours may follow
    soup.points.emplace_back(x, y, z);
  }
  for (long f = 0; f < n_faces; ++f) {
    next_line("face " + std::to_string(f) + " of " + std::to_string(n_faces));
    const long n = lines.integer();
    if (n < 3) lines.fail("face with " + std::to_string(n) + " corner(s), expected at least 3");
    std::vector<int> corners;
    for (long c = 0; c < n; ++c) {
      const long v = lines.integer();
      if (v < 0 || v >= n_vertices)
        lines.fail("vertex " + std::to_string(v) + ", expected 0 to " + std::to_string(n_vertices - 1));
      corners.push_back(static_cast<int>(v));
    }
    soup.add_polygon(corners, name);
  }
  return soup;
}

}  // namespace testbed::meshing
