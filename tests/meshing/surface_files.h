// Surface files that the project reads and does not write, as bytes.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <sstream>
#include <string>

#include "meshing/base/mesh.h"

template <class T>
void append(std::string& bytes, T value, bool is_big_endian) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  if (is_big_endian) std::reverse(raw, raw + sizeof(T));
  bytes.append(raw, sizeof(T));
}

inline std::string ply_of(const testbed::meshing::SurfaceMesh& mesh, bool is_big_endian) {
  std::string bytes =
      std::string("ply\nformat binary_") + (is_big_endian ? "big" : "little") +
      "_endian 1.0\ncomment made\nelement vertex " + std::to_string(mesh.X.cols()) +
      "\nproperty double x\nproperty double y\nproperty double z\nproperty uchar red\nelement face " +
      std::to_string(mesh.F.cols()) + "\nproperty list uchar int vertex_indices\nend_header\n";
  for (const auto& x : mesh.X.colwise()) {
    for (double value : x) append(bytes, value, is_big_endian);
    append<std::uint8_t>(bytes, 7, is_big_endian);
  }
  for (const auto& f : mesh.F.colwise()) {
    append<std::uint8_t>(bytes, 3, is_big_endian);
    for (int v : f) append(bytes, v, is_big_endian);
  }
  return bytes;
}

inline std::string binary_stl_of(const testbed::meshing::SurfaceMesh& mesh, std::string header) {
  header.resize(80);
  append(header, static_cast<std::uint32_t>(mesh.F.cols()), false);
  for (const auto& f : mesh.F.colwise()) {
    for (int c = 0; c < 3; ++c) append(header, 0.f, false);  // normals need not be right
    for (int v : f)
      for (double x : mesh.X.col(v)) append(header, static_cast<float>(x), false);
    append<std::uint16_t>(header, 0, false);
  }
  return header;
}

inline std::string text_stl_of(const testbed::meshing::SurfaceMesh& mesh) {
  std::ostringstream text;
  text.precision(17);
  text << "solid ball\n";
  for (const auto& f : mesh.F.colwise()) {
    text << "facet normal 0 0 0\n outer loop\n";
    for (int v : f) text << "  vertex " << mesh.X.col(v).transpose() << '\n';
    text << " endloop\nendfacet\n";
  }
  text << "endsolid ball\n";
  return text.str();
}

inline std::string vtk_array(const std::string& name, const std::string& type, const std::string& values) {
  return "<DataArray Name=\"" + name + "\" type=\"" + type + "\" format=\"ascii\"" +
         (name == "points" ? " NumberOfComponents=\"3\">" : ">") + values + "</DataArray>";
}

inline const std::string kCornersOfUnitTetrahedron = "0 0 0 1 0 0 0 1 0 0 0 1";

/// An unstructured grid: the corners of all cells, for each where they end, and its type.
inline std::string vtu_of(const std::string& corners, const std::string& ends, const std::string& types,
                          const std::string& points = kCornersOfUnitTetrahedron) {
  const auto n_words = [](const std::string& text) {
    return std::to_string(text.empty() ? 0 : std::count(text.begin(), text.end(), ' ') + 1);
  };
  return "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\">"
         "<UnstructuredGrid><Piece NumberOfPoints=\"" +
         std::to_string((std::count(points.begin(), points.end(), ' ') + 1) / 3) + "\" NumberOfCells=\"" +
         n_words(types) + "\"><Points>" + vtk_array("points", "Float64", points) + "</Points><Cells>" +
         vtk_array("connectivity", "Int64", corners) + vtk_array("offsets", "Int64", ends) +
         vtk_array("types", "UInt8", types) + "</Cells></Piece></UnstructuredGrid></VTKFile>";
}

/// Poly data on the unit tetrahedron: polygons as above, and one cell of another kind ("Lines", "Strips").
inline std::string vtp_of(const std::string& corners, const std::string& ends,
                          const std::string& other = "Lines", const std::string& other_corners = "0 1 2 3") {
  const auto cells = [](const std::string& c, const std::string& e) {
    return vtk_array("connectivity", "Int64", c) + vtk_array("offsets", "Int64", e);
  };
  return "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\"><PolyData>"
         "<Piece NumberOfPoints=\"4\" NumberOf" +
         other + "=\"1\" NumberOfPolys=\"" + std::to_string(std::count(ends.begin(), ends.end(), ' ') + 1) +
         "\"><Points>" + vtk_array("points", "Float64", kCornersOfUnitTetrahedron) + "</Points><Polys>" +
         cells(corners, ends) + "</Polys><" + other + ">" + cells(other_corners, "4") + "</" + other +
         "></Piece></PolyData></VTKFile>";
}
