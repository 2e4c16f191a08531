// Error of every spring model against exact polynomial fields, beside linear finite elements on the same
// nodes.
#include <CLI/CLI.hpp>
#include <Eigen/Geometry>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <set>
#include <sstream>

#include "massspring/calibrations/calibrate.h"
#include "massspring/energies/tractions.h"
#include "massspring/statics/exact_fields.h"
#include "massspring/statics/linear_statics.h"
#include "meshing/network/build_network.h"
#include "meshing/scene/scene.h"
#include "meshing/surface/surface.h"

namespace testbed::massspring {

namespace {

using Eigen::Matrix3Xd;

struct Options {
  std::string out;
  std::vector<std::string> surfaces, models;
  std::vector<double> nu{0, 0.25, 0.3, 0.45, 0.49}, spacings{0.7};
  std::vector<std::uint64_t> seeds{1};
  double link_share = 0;
};

constexpr const char* kHeader =
    "surface,spacing,seed,n_surface,n_nodes,n_tets,n_springs,nu,model,load,status,error_l2,error_max,"
    "compliance,"
    "volume_change_error,iterations,setup_seconds,solve_seconds\n";

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// "torus:924" is a generated shape of about 924 vertices, anything else a file. Scaled to a smallest side
/// of 1.
SurfaceMesh surface_of(const std::string& name) {
  SurfaceSource source;
  source.normalise = true;
  const auto colon = name.rfind(':');
  if (colon != std::string::npos && name.find_first_not_of("0123456789", colon + 1) == std::string::npos) {
    source.shape = name.substr(0, colon);
    source.n_vertices = std::stoi(name.substr(colon + 1));
  } else {
    source.file = name;
  }
  return load_surface(source);
}

/// Linear change of volume (m3) under displacements u.
double volume_change(const Matrix3Xd& X, const Eigen::Matrix3Xi& F, const Matrix3Xd& u) {
  double change = 0;
  for (const auto& t : F.colwise()) {
    const Eigen::Vector3d a = X.col(t[0]), b = X.col(t[1]), c = X.col(t[2]);
    change += (b - a).cross(c - a).dot(u.col(t[0]) + u.col(t[1]) + u.col(t[2])) / 6;
  }
  return change;
}

/// Seed 0: the mesher's inner nodes, `spacing` of the surface's apart. Other seeds: random inner nodes.
SpringNetwork network_of(const SurfaceMesh& surface, double spacing, std::uint64_t seed) {
  NetworkOptions options;
  options.spacing = spacing;
  options.sampling = seed == 0 ? "mesher" : "darts";
  options.seed = seed;
  options.connectivity = "completed_pcp";  // the paper's own has floppy motions: no answer without a hold
  return build_network(surface, options, true, true);
}

class Table {
 public:
  /// Rows of an earlier run are kept and not computed again.
  explicit Table(const std::string& file) {
    std::ifstream before(file);
    std::string line;
    while (std::getline(before, line)) done_.insert(key_of(line));
    out_.open(file, std::ios::app);
    if (!out_) throw std::runtime_error(file + ": cannot be written");
    if (done_.empty()) out_ << kHeader;
  }
  bool has(const std::string& key) const { return done_.count(key) > 0; }
  void add(const std::string& row) { out_ << row << std::endl; }

 private:
  static std::string key_of(const std::string& row) {
    std::vector<std::string> columns;
    std::stringstream stream(row);
    for (std::string column; std::getline(stream, column, ',');) columns.push_back(column);
    if (columns.size() < 10) return row;
    return columns[0] + ',' + columns[1] + ',' + columns[2] + ',' + columns[7] + ',' + columns[8] + ',' +
           columns[9];
  }
  std::set<std::string> done_;
  std::ofstream out_;
};

std::string text(double value) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%.6g", value);
  return buffer;
}

/// All loads of one model on one network.
void measure(const SpringNetwork& network, const std::string& name, double nu, double link_share,
             const std::string& mesh_columns, const std::string& mesh_key, Table& table) {
  std::vector<std::string> missing;
  for (const std::string& load : exact_field_names())
    if (!table.has(mesh_key + ',' + text(nu) + ',' + name + ',' + load)) missing.push_back(load);
  if (missing.empty()) return;

  auto start = std::chrono::steady_clock::now();
  std::optional<LinearStatics> statics;
  std::string refusal;
  Material material;
  material.nu = nu;
  std::size_t n_springs = 0;
  try {
    const Calibration& calibration = find_calibration(name);
    const MassSpringModel model = link_share > 0
                                      ? calibrate_with_links(network, material, calibration, link_share)
                                      : calibrate(network, material, calibration);
    n_springs = model.springs ? model.springs->E.cols() : 0;
    statics.emplace(model, hold_rigid_motion(network.X));
  } catch (const std::runtime_error& error) {
    refusal = error.what();
  }
  const double setup_seconds = seconds_since(start);
  const std::string head = mesh_columns + ',' + std::to_string(n_springs) + ',' + text(nu) + ',' + name + ',';
  for (const std::string& load : missing) {
    if (!statics) {
      for (char& c : refusal)
        if (c == ',') c = ';';
      table.add(head + load + ",refused: " + refusal + ",,,,,,,");
      continue;
    }
    const ExactField field = exact_field(load, lame_of(material), network.X.rowwise().mean());
    const Matrix3Xd f = traction_forces(field.stress, network.X, network.F),
                    exact = displacements(field, network.X);
    Matrix3Xd u;
    start = std::chrono::steady_clock::now();
    const SolveReport report = statics->solve(f, u, 1e-10);
    const double solve_seconds = seconds_since(start);
    const SurfaceError error = surface_error(u, exact, network.X, network.F);
    const double dV = volume_change(network.X, network.F, u),
                 dV_exact = volume_change(network.X, network.F, exact);
    std::ostringstream row;
    row.precision(6);
    row << head << load << ',' << (report.is_converged ? "ok" : "not converged") << ',' << error.l2 << ','
        << error.largest << ',' << f.cwiseProduct(u).sum() / f.cwiseProduct(exact).sum() << ','
        << (dV - dV_exact) / volume(network.X, network.F) << ',' << report.iterations << ',' << setup_seconds
        << ',' << solve_seconds;
    table.add(row.str());
  }
}

int run(const Options& options) {
  Table table(options.out);
  for (const std::string& name : options.surfaces) {
    const SurfaceMesh surface = surface_of(name);
    for (double spacing : options.spacings)
      for (std::uint64_t seed : options.seeds) {
        const std::string short_name = name.substr(name.rfind('/') + 1);
        const std::string key = short_name + ',' + text(spacing) + ',' + std::to_string(seed);
        SpringNetwork network;
        try {
          network = network_of(surface, spacing, seed);
        } catch (const std::runtime_error& error) {
          std::cerr << key << ": no tetrahedra: " << error.what() << '\n';
          continue;
        }
        std::cerr << key << ": " << network.X.cols() << " nodes, " << network.T.cols() << " tetrahedra\n";
        const std::string columns = key + ',' + std::to_string(network.n_surface) + ',' +
                                    std::to_string(network.X.cols()) + ',' + std::to_string(network.T.cols());
        for (double nu : options.nu)
          for (const std::string& model : options.models)
            measure(network, model, nu, options.link_share, columns, key, table);
      }
  }
  return 0;
}

}  // namespace

}  // namespace testbed::massspring

int main(int argc, char** argv) {
  testbed::massspring::Options options;
  CLI::App app{
      "Measures spring models against exact fields of elasticity, applied as tractions: one CSV row per "
      "surface, inner nodes, Poisson's "
      "ratio, model and load. The model edge_coupled is linear finite elements on the same nodes. Rows "
      "already in the file are kept.\n"
      "example: accuracy --out accuracy.csv --surface ball:642 --surface bunny.obj --nu 0.25 0.49"};
  for (const testbed::massspring::Calibration& c : testbed::massspring::calibrations())
    options.models.push_back(c.name);
  app.add_option("--out", options.out, "CSV file, continued if it exists")->required();
  app.add_option("--surface", options.surfaces, "file, or SHAPE:VERTICES of a generated shape")->required();
  app.add_option("--nu", options.nu, "Poisson's ratios");
  app.add_option("--spacing", options.spacings, "of the mesher's inner nodes, over the surface's nearby");
  app.add_option("--seed", options.seeds, "0: the mesher's own inner nodes; others: random inner nodes");
  app.add_option(
      "--link-share", options.link_share,
      "of the material that PCP links stand for beside coupled springs; a file of its own for each");
  app.add_option("--model", options.models, "spring models; all if absent");
  CLI11_PARSE(app, argc, argv);
  try {
    for (const std::string& model : options.models) testbed::massspring::find_calibration(model);
    return testbed::massspring::run(options);
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << '\n';
    return 1;
  }
}
