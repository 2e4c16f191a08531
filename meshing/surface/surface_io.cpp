// Readers of our own but for VTK's files: VTK's return float32, split vertices at OBJ normals and know no OFF. Where one
// is needed, a process of its own makes OFF of the file.
#include "meshing/surface/surface_io.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <sstream>
#include <stdexcept>

#include "meshing/base/child_process.h"
#include "meshing/base/files.h"
#include "meshing/surface/surface_readers.h"

namespace testbed::meshing {

namespace {

std::string lower_extension(const std::filesystem::path& file) {
  std::string extension = file.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

/// First point with the same position, for each point.
std::vector<int> first_equals(const std::vector<Eigen::Vector3d>& points) {
  std::vector<int> order(points.size()), first(points.size());
  std::iota(order.begin(), order.end(), 0);
  auto key = [&](int i) { return std::tuple(points[i][0], points[i][1], points[i][2]); };
  std::sort(order.begin(), order.end(),
            [&](int i, int j) { return std::pair(key(i), i) < std::pair(key(j), j); });
  for (size_t o = 0; o < order.size(); ++o)
    first[order[o]] = o > 0 && key(order[o - 1]) == key(order[o]) ? first[order[o - 1]] : order[o];
  return first;
}

/// @param new_index  of each point
SurfaceMesh merge_equal_points(const PolygonSoup& soup, std::vector<int>& new_index) {
  const std::vector<int> first = first_equals(soup.points);
  new_index.resize(first.size());
  SurfaceMesh mesh{Eigen::Matrix3Xd(3, soup.points.size()), Eigen::Matrix3Xi(3, soup.triangles.size())};
  int n = 0;
  for (size_t i = 0; i < first.size(); ++i)
    if (first[i] == static_cast<int>(i)) {
      new_index[i] = n;
      mesh.X.col(n++) = soup.points[i];
    } else {
      new_index[i] = new_index[first[i]];
    }
  mesh.X.conservativeResize(3, n);
  for (size_t f = 0; f < soup.triangles.size(); ++f)
    mesh.F.col(f) = soup.triangles[f].unaryExpr([&](int v) { return new_index[v]; });
  return mesh;
}

/// Limits grow with the file: what VTK's reader takes of memory and time on files that are as they should be is less than
/// a tenth of them.
PolygonSoup read_by_vtk(const std::filesystem::path& file, const std::string& type, size_t n_bytes) {
  constexpr double kStart = 5, kByte = 5e-7, kWaiting = 10;  // s, s, wall time for each second of computing
  constexpr double kMemory = 1e9, kMemoryOfByte = 60;
  const auto n = static_cast<double>(n_bytes);
  const double seconds = kStart + kByte * n;
  const TemporaryFolder folder;
  const std::string off = folder.path() / "surface.off", name = file.string();
  const ChildResult child = run_child(program_folder() / "vtk_worker", {type, name, off}, kWaiting * seconds,
                                      seconds, kMemory + kMemoryOfByte * n);
  if (child.is_success) return read_off(read_file(off), name);
  const bool is_told = child.ending == "status 1" && child.output.find(name) == 0;
  throw std::runtime_error(is_told ? child.output
                                   : name + ": VTK's reader fails on it (" + child.ending +
                                         "), expected an undamaged file");
}

/// @throws std::runtime_error where doubles have no digits left for the shape.
void check_place(const SurfaceMesh& mesh, const std::string& name) {
  constexpr double kFarthest = 1e9;  // of the body's size: seven digits are left
  const double size = (mesh.X.rowwise().maxCoeff() - mesh.X.rowwise().minCoeff()).maxCoeff();
  const double farthest = mesh.X.cwiseAbs().maxCoeff();
  if (farthest <= kFarthest * size) return;
  std::ostringstream what;
  what << name << ": lies " << farthest << " from the origin at a size of " << size
       << ", expected at most 1e9 times its size";
  throw std::runtime_error(what.str());
}

}  // namespace

std::string shortened(std::string_view found) {
  constexpr size_t kLong = 40;
  return std::string(found.substr(0, kLong)) + (found.size() > kLong ? "..." : "");
}

template <class Number>
static std::optional<Number> parse(std::string_view token) {
  if (!token.empty() && token.front() == '+') token.remove_prefix(1);
  Number value{};
  const auto [end, error] = std::from_chars(token.data(), token.data() + token.size(), value);
  if (error != std::errc{} || end != token.data() + token.size()) return {};
  return value;
}

std::optional<double> parse_double(std::string_view token) {
  return parse<double>(token);
}
std::optional<long> parse_integer(std::string_view token) {
  return parse<long>(token);
}

TextLines::TextLines(std::string_view text, std::string name) : text_(text), name_(std::move(name)) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (text_.substr(0, 3) == kByteOrderMark) text_.remove_prefix(3);
}

bool TextLines::next() {
  while (!text_.empty()) {
    const size_t end = text_.find_first_of("\r\n");
    line_ = text_.substr(0, end);
    ++number_;
    if (end == std::string_view::npos)
      text_ = {};
    else
      text_.remove_prefix(end + (text_.substr(end, 2) == "\r\n" ? 2 : 1));
    line_ = line_.substr(0, line_.find('#'));
    if (line_.find_first_not_of(" \t\v\f") != std::string_view::npos) return true;
  }
  line_ = {};
  return false;
}

std::string_view TextLines::token() {
  line_.remove_prefix(std::min(line_.find_first_not_of(" \t\v\f"), line_.size()));
  const std::string_view found = line_.substr(0, line_.find_first_of(" \t\v\f"));
  line_.remove_prefix(found.size());
  return found;
}

double TextLines::number() {
  const std::string_view found = token();
  const auto value = parse_double(found);
  if (!value || !std::isfinite(*value)) fail("'" + shortened(found) + "', expected a finite number");
  return *value;
}

long TextLines::integer() {
  const std::string_view found = token();
  const auto value = parse_integer(found);
  if (!value) fail("'" + shortened(found) + "', expected a whole number");
  return *value;
}

void TextLines::fail(const std::string& message) const {
  throw std::runtime_error(name_ + ":" + std::to_string(number_) + ": " + message);
}

SurfaceMesh read_surface(const std::filesystem::path& file, ReadReport* report) {
  constexpr std::uintmax_t kMost = 1000000000;
  const std::string extension = lower_extension(file), name = file.string();
  std::error_code absent;  // which reading tells
  if (const auto n = std::filesystem::file_size(file, absent); !absent && n > kMost)
    throw std::runtime_error(name + ": " + std::to_string(n) + " bytes, expected at most " +
                             std::to_string(kMost) + " of a surface");
  const std::string bytes = read_file(file);
  const std::map<std::string, PolygonSoup (*)(std::string_view, const std::string&)> readers{
      {".obj", read_obj}, {".off", read_off}, {".ply", read_ply}, {".stl", read_stl}};
  const auto reader = readers.find(extension);
  const bool is_vtk = extension == ".vtp" || extension == ".vtu";
  if (reader == readers.end() && !is_vtk)
    throw std::runtime_error(name + ": extension '" + extension +
                             "', expected .obj, .off, .ply, .stl, .vtp or .vtu");
  PolygonSoup soup =
      is_vtk ? read_by_vtk(file, extension.substr(1), bytes.size()) : reader->second(bytes, name);
  for (size_t i = 0; i < soup.points.size(); ++i)
    if (!soup.points[i].allFinite())
      throw std::runtime_error(name + ": vertex " + std::to_string(i) +
                               " has a coordinate that is not finite");
  if (soup.triangles.empty()) throw std::runtime_error(name + ": no triangles, expected a surface");
  std::vector<int> new_index;
  SurfaceMesh mesh = merge_equal_points(soup, new_index);
  check_place(mesh, name);
  if (report)
    *report = {static_cast<int>(new_index.size() - mesh.X.cols()), std::move(soup.points),
               std::move(soup.triangles), std::move(new_index)};
  return mesh;
}

void write_surface(const std::filesystem::path& file, const SurfaceMesh& surface) {
  const std::string extension = lower_extension(file);
  if (extension != ".obj" && extension != ".off")
    throw std::runtime_error(file.string() + ": extension '" + extension + "', expected .obj or .off");
  const bool is_obj = extension == ".obj";
  std::ostringstream text;
  text.precision(std::numeric_limits<double>::max_digits10);
  if (!is_obj) text << "OFF\n" << surface.X.cols() << ' ' << surface.F.cols() << " 0\n";
  for (const auto& x : surface.X.colwise())
    text << (is_obj ? "v " : "") << x[0] << ' ' << x[1] << ' ' << x[2] << '\n';
  const int base = is_obj ? 1 : 0;
  for (const auto& f : surface.F.colwise())
    text << (is_obj ? "f " : "3 ") << f[0] + base << ' ' << f[1] + base << ' ' << f[2] + base << '\n';
  write_file(file, text.str());
}

}  // namespace testbed::meshing
