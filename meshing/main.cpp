// meshing: surfaces, spring networks and tetrahedra on the command line.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <iostream>

#include "meshing/network/build_network.h"
#include "meshing/network/connect.h"
#include "meshing/network/rigidity.h"
#include "meshing/run/exit_status.h"
#include "meshing/run/record.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_check.h"
#include "meshing/surface/surface_faults.h"
#include "meshing/surface/surface_io.h"
#include "meshing/tetrahedra/tet_mesh.h"

using namespace testbed::meshing;

namespace {

constexpr int kVtkLine = 3, kVtkTriangle = 5, kVtkTetra = 10;

/// Nodes and cells for ParaView; n_surface as field data.
void write_cells(const std::string& file, const Eigen::Matrix3Xd& X, const std::vector<CellBlock>& cells,
                 int n_surface) {
  write_vtu(file, X, cells, {}, {{"n_surface", n_surface}});
}

void add_check(CLI::App& app) {
  struct Arguments {
    std::string file;
    bool is_json = false;
  };
  auto* command =
      app.add_subcommand("check", "Report whether a simulation can use a surface: exit status 0 if so");
  auto arguments = std::make_shared<Arguments>();
  command->add_option("file", arguments->file, "OBJ, OFF, PLY or STL")->required();
  command->add_flag("--json", arguments->is_json, "report as JSON");
  command->callback([arguments] {
    ReadReport read;
    const SurfaceMesh surface = read_surface(arguments->file, &read);
    SurfaceReport report = report_surface(surface, read.n_merged);
    if (arguments->is_json) {
      report.values["problems"] = report.problems;
      std::cout << report.values.dump(2) << '\n';
    } else {
      for (const auto& [key, value] : report.values.items()) std::cout << key << ' ' << value.dump() << '\n';
      for (const std::string& problem : report.problems) std::cout << "problem: " << problem << '\n';
    }
    if (!report.problems.empty()) throw CLI::RuntimeError(1);
  });
}

void add_repair(CLI::App& app) {
  struct Arguments {
    std::string in, out;
  };
  auto* command = app.add_subcommand(
      "repair",
      "Merge equal positions, drop what bounds nothing, orient outward; holes and crossings stay errors");
  auto arguments = std::make_shared<Arguments>();
  command->add_option("in", arguments->in, "surface")->required();
  command->add_option("out", arguments->out, "file to write (.obj or .off)")->required();
  command->callback([arguments] {
    ReadReport read;
    RepairReport done;
    const SurfaceMesh mended = repair(read_surface(arguments->in, &read), done);
    std::printf("merged vertices %d\ndropped vertices %d\ndropped degenerate triangles %d\n", read.n_merged,
                done.n_unused_vertices, done.n_degenerate_triangles);
    std::printf("dropped doubled triangles %d\nturned triangles %d\n", done.n_doubled_triangles,
                done.n_turned_triangles);
    write_surface(arguments->out, mended);
    const SurfaceReport report = report_surface(mended, 0);
    for (const std::string& problem : report.problems) std::cout << "problem: " << problem << '\n';
    if (!report.problems.empty()) throw CLI::RuntimeError(1);
  });
}

void add_shape(CLI::App& app) {
  struct Arguments {
    std::string name, out;
    int n_vertices = 642;
    std::vector<double> size{0, 0, 0};
  };
  auto* command = app.add_subcommand("shape", "Generate a closed surface");
  auto arguments = std::make_shared<Arguments>();
  command->add_option("name", arguments->name, "ball, hollow_ball, torus, bar, handle or head")
      ->required()
      ->check(CLI::IsMember(shape_names()));
  command->add_option("out", arguments->out, "file to write (.obj or .off)")->required();
  command->add_option("--vertices", arguments->n_vertices, "wanted; the nearest possible is made")
      ->capture_default_str();
  command->add_option("--size", arguments->size, "bounding box (m); 0: the shape's own")->expected(3);
  command->callback([arguments] {
    const SurfaceMesh surface = make_shape(arguments->name, arguments->n_vertices,
                                           Eigen::Map<Eigen::Vector3d>(arguments->size.data()));
    write_surface(arguments->out, surface);
    std::printf("%s: %ld vertices, %ld triangles\n", arguments->out.c_str(), surface.X.cols(),
                surface.F.cols());
  });
}

void print_network(const SpringNetwork& network, const SurfaceMesh& surface) {
  const long n_edges = edges_of(surface.F).cols();
  std::printf("nodes %ld (surface %d, internal %ld)\nsprings %ld (surface edges %ld)\n", network.X.cols(),
              network.n_surface, network.X.cols() - network.n_surface, network.E.cols(), n_edges);
  std::printf("coordination %.2f\nweak nodes %zu\n", 2.0 * network.E.cols() / network.X.cols(),
              weak_nodes(network).size());
  const SurfaceTree tree(surface);
  long n_outside = 0;
  for (long s = n_edges; s < network.E.cols(); ++s)
    n_outside += !is_inside(tree, network.X, network.n_surface, network.E(0, s), network.E(1, s));
  std::printf("links outside the solid %ld\n", n_outside);
  constexpr int kMostNodes = 20000;  // the factorisation takes a minute there
  if (network.X.cols() <= kMostNodes)
    std::printf("floppy modes %d\n", count_floppy_modes(network));
  else
    std::printf("floppy modes not counted above %d nodes (completed_pcp has none by construction)\n",
                kMostNodes);
}

void print_quality(const TetMesh& mesh) {
  const TetQuality quality = tet_quality(mesh.X, mesh.T);
  std::printf(
      "tetrahedra %ld\nleast dihedral angle %.3g degrees\nradius ratio least %.3g, mean %.3g\nslivers %d\n",
      mesh.T.cols(), quality.min_dihedral, quality.min_radius_ratio, quality.mean_radius_ratio,
      quality.n_slivers);
}

void print_attempts(const TetReport& report) {
  for (const std::string& failure : report.failures) std::fprintf(stderr, "failed: %s\n", failure.c_str());
  std::printf("mesher %s\n", report.mesher.c_str());
}

void add_network(CLI::App& app) {
  struct Arguments {
    std::string file, out, connectivity = "pcp";
    NetworkOptions nodes;
    ConnectOptions connect;
    bool has_tetrahedra = false;
  };
  auto* command =
      app.add_subcommand("network", "Fill a surface with internal nodes and join them by springs");
  auto arguments = std::make_shared<Arguments>();
  command->add_option("file", arguments->file, "surface")->required();
  command->add_option("out", arguments->out,
                      "file to write (.vtu): triangles, then springs, then tetrahedra");
  command
      ->add_option("--sampling", arguments->nodes.sampling,
                   "of internal nodes: darts, relaxed, graded, mesher")
      ->capture_default_str();
  command->add_option("--phi", arguments->nodes.phi, "least distance of internal nodes (normalised box)");
  command->add_option("--psi", arguments->nodes.psi, "least distance to the surface (normalised box)");
  command->add_option("-k,--nodes", arguments->nodes.k,
                      "internal nodes wanted (absent: as many as fit, at most 3 for each of the surface)");
  command->add_option("--seed", arguments->nodes.seed, "of the random nodes")->capture_default_str();
  command->add_option("--spacing", arguments->nodes.spacing, "mesher: edges inside over the surface's nearby")
      ->capture_default_str();
  command->add_flag("--tetrahedra", arguments->has_tetrahedra, "on the same nodes");
  command
      ->add_option("--multiplicity", arguments->connect.pcp.multiplicity,
                   "PCP: springs projected by each white node")
      ->capture_default_str();
  std::map<std::string, PcpReading> readings;
  for (const auto& [reading, name] : names_of(PcpReading())) readings[name] = reading;
  command->add_option("--reading", arguments->connect.pcp.reading, "of PCP's pseudocode")
      ->transform(CLI::CheckedTransformer(readings));
  command->add_option("--connectivity", arguments->connectivity, "how nodes are joined")
      ->check(CLI::IsMember(all_names<Connectivity>()))
      ->capture_default_str();
  command
      ->add_option("--neighbours", arguments->connect.neighbours,
                   "completed_pcp: nearest neighbours of each node")
      ->capture_default_str();
  command->callback([arguments] {
    const SurfaceMesh surface = read_surface(arguments->file);
    check_closed(surface, arguments->file);
    NodeReport found;
    const TetMesh nodes = place_nodes(surface, arguments->nodes, arguments->has_tetrahedra, &found);
    const Eigen::Matrix3Xd interior = nodes.X.rightCols(nodes.X.cols() - nodes.n_surface);
    if (arguments->nodes.k && interior.cols() < *arguments->nodes.k)
      std::fprintf(stderr, "only %ld of %d internal nodes fit\n", interior.cols(), *arguments->nodes.k);
    if (const auto& most = found.samples.most_nodes)
      std::fprintf(stderr, "internal nodes bounded by %d, with phi = %.3g: --nodes or --phi asks for more\n",
                   *most, found.samples.phi);
    arguments->connect.connectivity = connectivity_of(arguments->connectivity);
    PcpReport report;
    const SpringNetwork network = connect(surface, interior, arguments->connect, &report);
    print_network(network, surface);
    std::printf("PCP stages %zu\n", report.white_per_stage.size());
    std::vector<CellBlock> cells{{kVtkTriangle, network.F}, {kVtkLine, network.E}};
    if (nodes.T.cols() > 0) {
      print_attempts(found.tets);
      print_quality(nodes);
      cells.push_back({kVtkTetra, nodes.T});
    }
    if (!arguments->out.empty()) write_cells(arguments->out, network.X, cells, network.n_surface);
  });
}

void add_tetrahedralize(CLI::App& app) {
  struct Arguments {
    std::string file, out;
    TetOptions tets;
  };
  auto* command =
      app.add_subcommand("tetrahedralize", "Fill a surface with tetrahedra, its vertices kept bit for bit");
  auto arguments = std::make_shared<Arguments>();
  command->add_option("file", arguments->file, "surface")->required();
  command->add_option("out", arguments->out, "file to write (.vtu): triangles, then tetrahedra");
  command->add_option("--interior-size", arguments->tets.interior_size, "longest edge inside (m)");
  command->add_option("--time-limit", arguments->tets.time_limit,
                      "for each attempt of a mesher, of its own computing (s; absent: 5 and 0.001 for each "
                      "triangle)");
  command->callback([arguments] {
    const SurfaceMesh surface = read_surface(arguments->file);
    TetReport report;
    const TetMesh mesh = tetrahedralize(surface, arguments->tets, &report);
    print_attempts(report);
    std::printf("nodes %ld (surface %d)\n", mesh.X.cols(), mesh.n_surface);
    print_quality(mesh);
    if (!arguments->out.empty())
      write_cells(arguments->out, mesh.X, {{kVtkTriangle, mesh.F}, {kVtkTetra, mesh.T}}, mesh.n_surface);
  });
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Surfaces in; spring networks and tetrahedra out.");
  app.require_subcommand(1);
  app.footer(
      "Examples:\n"
      "  meshing check bunny.obj --json\n"
      "  meshing repair scan.stl clean.obj\n"
      "  meshing shape torus torus.obj --vertices 924\n"
      "  meshing network torus.obj torus.vtu --nodes 500 --multiplicity 5\n"
      "  meshing network bunny.obj bunny.vtu --connectivity completed_pcp --tetrahedra\n"
      "  meshing tetrahedralize bunny.obj bunny.vtu --interior-size 0.1");
  add_check(app);
  add_repair(app);
  add_shape(app);
  add_network(app);
  add_tetrahedralize(app);
  try {
    return parse(app, argc, argv).value_or(kSolved);
  } catch (const std::exception& error) {
    end_by(error.what());
  }
}
