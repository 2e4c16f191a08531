// CalculiX as an independent program on the same tetrahedra.
#pragma once

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <map>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "fem_reference/solid/elasticity.h"
#include "meshing/base/child_process.h"
#include "meshing/base/files.h"

namespace testbed::fem {

/// A rigid body above the solid, of bricks whose lower side is a graph.
struct CalculixTool {
  std::function<double(double x, double y)> height;  ///< of its lower side (m)
  double low, high;                                  ///< of x and of y (m)
  int n_bricks;                                      ///< along each
  Eigen::Vector3d displacement;                      ///< m
  double friction;                                   ///< Coulomb's coefficient
  std::vector<int> faces;                            ///< boundary triangles that may touch it
};

/// What CalculiX is asked about the nodes and cells of a solid.
struct CalculixJob {
  Material material;
  std::vector<ConstrainedComponent> constrained;
  Eigen::Vector3d gravity{0, 0, 0};  ///< m/s2
  /// Boundary triangle, Pa: follows the surface at finite strain.
  std::vector<std::pair<int, double>> pressures;
  bool is_finite_strain = false;  ///< St. Venant-Kirchhoff
  std::optional<CalculixTool> tool = {};
  double increment = 0.1;  ///< of the load at finite strain or in contact
  int n_frequencies = 0;   ///< > 0: natural frequencies instead of equilibrium
};

struct CalculixResult {
  Eigen::Matrix3Xd u;               ///< m, 7 digits
  std::vector<double> frequencies;  ///< Hz, 7 digits
};

inline bool has_calculix() {
  return std::system("command -v ccx > /dev/null") == 0;
}

inline std::string calculix_number(double x) {
  char text[32];
  std::snprintf(text, sizeof text, "%.12e", x);  // input fields hold 20 characters
  return text;
}

/// The tool's nodes and bricks, numbered behind those of the solid. All its nodes are moved.
inline std::string calculix_tool(const CalculixTool& tool, int n_nodes, int n_cells) {
  std::ostringstream nodes, bricks;
  const int n = tool.n_bricks, n_layer = (n + 1) * (n + 1);
  const double h = (tool.high - tool.low) / n;
  for (int k = 0; k < 2; ++k)
    for (int j = 0; j <= n; ++j)
      for (int i = 0; i <= n; ++i) {
        const double x = tool.low + i * h, y = tool.low + j * h;
        nodes << n_nodes + 1 + k * n_layer + j * (n + 1) + i << ", " << calculix_number(x) << ", "
              << calculix_number(y) << ", " << calculix_number(tool.height(x, y) + k * h) << '\n';
      }
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) {
      bricks << n_cells + 1 + j * n + i;
      for (int k = 0; k < 2; ++k)
        for (const int at :
             {j * (n + 1) + i, j * (n + 1) + i + 1, (j + 1) * (n + 1) + i + 1, (j + 1) * (n + 1) + i})
          bricks << ", " << n_nodes + 1 + k * n_layer + at;
      bricks << '\n';
    }
  return "*NODE, NSET=TOOL\n" + nodes.str() + "*ELEMENT, ELSET=BRICKS, TYPE=C3D8\n" + bricks.str() +
         "*SOLID SECTION, ELSET=BRICKS, MATERIAL=M\n*SURFACE, NAME=OVER\nBRICKS, S1\n";
}

/// Nodes of CalculiX's C3D10 follow VTK's order; gmsh's swaps the last two.
inline std::string calculix_input(const ElasticSolid& solid, const CalculixJob& job) {
  std::ostringstream out;
  const auto number = calculix_number;
  const auto side_name = [](const std::pair<int, int>& side, char letter) {
    return std::to_string(side.first) + ", " + letter + std::to_string(side.second);
  };
  out << "*NODE, NSET=ALL\n";
  for (int i = 0; i < solid.X().cols(); ++i) {
    out << i + 1;
    for (double x : solid.X().col(i)) out << ", " << number(x);
    out << '\n';
  }
  out << "*ELEMENT, ELSET=BODY, TYPE=" << (solid.cells().rows() == 4 ? "C3D4" : "C3D10") << '\n';
  std::map<std::array<int, 3>, std::pair<int, int>>
      side_of;  // by sorted corners: element, number of its face
  constexpr int kSides[4][3] = {{0, 1, 2}, {0, 3, 1}, {1, 3, 2}, {2, 3, 0}};
  const auto sorted = [](int a, int b, int c) {
    std::array<int, 3> key{{a, b, c}};
    std::sort(key.begin(), key.end());
    return key;
  };
  for (int t = 0; t < solid.cells().cols(); ++t) {
    const auto cell = solid.cells().col(t);
    out << t + 1;
    for (int node : cell) out << ", " << node + 1;
    out << '\n';
    for (int s = 0; s < 4; ++s)
      side_of[sorted(cell(kSides[s][0]), cell(kSides[s][1]), cell(kSides[s][2]))] = {t + 1, s + 1};
  }
  const auto side_of_face = [&](int f) {
    const auto face = solid.faces().col(f);
    return side_of.at(sorted(face(0), face(1), face(2)));
  };
  out << "*MATERIAL, NAME=M\n*ELASTIC\n"
      << number(job.material.E) << ", " << number(job.material.nu) << "\n*DENSITY\n"
      << number(job.material.rho) << "\n*SOLID SECTION, ELSET=BODY, MATERIAL=M\n";
  if (job.tool) {
    out << calculix_tool(*job.tool, static_cast<int>(solid.X().cols()),
                         static_cast<int>(solid.cells().cols()))
        << "*SURFACE, NAME=UNDER\n";
    for (const int f : job.tool->faces) out << side_name(side_of_face(f), 'S') << '\n';
    constexpr double kPenalty = 1e4, kStick = 1e3;  // E over a metre of overlap, and of slip for friction
    out << "*SURFACE INTERACTION, NAME=TOUCH\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n"
        << number(kPenalty * job.material.E) << '\n';
    if (job.tool->friction > 0)
      out << "*FRICTION\n" << job.tool->friction << ", " << number(kStick * job.material.E) << '\n';
    out << "*CONTACT PAIR, INTERACTION=TOUCH, TYPE=SURFACE TO SURFACE\nUNDER, OVER\n";
  }
  out << "*BOUNDARY\n";
  for (const ConstrainedComponent& h : job.constrained)
    if (h.displacement == 0) out << h.node + 1 << ", " << h.component + 1 << '\n';
  if (job.n_frequencies > 0) {
    out << "*STEP\n*FREQUENCY\n" << job.n_frequencies << "\n*NODE FILE\nU\n*END STEP\n";
    return out.str();
  }
  if (job.is_finite_strain)
    out << "*STEP, NLGEOM, INC=1000\n*STATIC, DIRECT\n"
        << job.increment << ", 1.0\n*CONTROLS, PARAMETERS=FIELD\n1e-8, 1e-8\n";
  else if (job.tool)
    out << "*STEP, INC=1000\n*STATIC\n"
        << job.increment << ", 1.0\n*CONTROLS, PARAMETERS=FIELD\n1e-6, 1e-6\n";
  else
    out << "*STEP\n*STATIC\n";
  out << "*BOUNDARY\n";
  if (job.tool)
    for (int c = 0; c < 3; ++c)
      out << "TOOL, " << c + 1 << ", " << c + 1 << ", " << number(job.tool->displacement(c)) << '\n';
  for (const ConstrainedComponent& h : job.constrained)
    if (h.displacement != 0)
      out << h.node + 1 << ", " << h.component + 1 << ", " << h.component + 1 << ", "
          << number(h.displacement) << '\n';
  out << "*DLOAD\n";
  if (job.gravity.norm() > 0) {
    out << "BODY, GRAV, " << number(job.gravity.norm());
    for (double g : job.gravity.normalized()) out << ", " << number(g);
    out << '\n';
  }
  for (const auto& [f, p] : job.pressures)
    out << side_name(side_of_face(f), 'P') << ", " << number(p) << '\n';
  out << "*NODE PRINT, NSET=ALL\nU\n*END STEP\n";
  return out.str();
}

/// @throws std::runtime_error with what CalculiX wrote when it fails.
inline CalculixResult run_calculix(const ElasticSolid& solid, const CalculixJob& job) {
  const TemporaryFolder folder;
  const std::string name = (folder.path() / "job").string();
  write_file(name + ".inp", calculix_input(solid, job));
  const ChildResult child = run_child("/usr/bin/env", {"-C", folder.path().string(), "ccx", "-i", name}, 300);
  std::ifstream printed(name + ".dat");
  if (!child.is_success || !printed)
    throw std::runtime_error("CalculiX: " + child.ending + "\n" + child.output);
  CalculixResult result;
  result.u.setZero(3, solid.X().cols());
  for (std::string line; std::getline(printed, line);) {
    std::istringstream words(line);
    int i;
    double a, b, c, d;
    if (!(words >> i >> a >> b >> c)) continue;
    if (job.n_frequencies == 0)
      result.u.col(i - 1) << a, b, c;  // the last step's stay
    else if (words >> d && static_cast<int>(result.frequencies.size()) < job.n_frequencies)
      result.frequencies.push_back(c);  // eigenvalue, rad/s, cycles/s, imaginary part
  }
  return result;
}

}  // namespace testbed::fem
