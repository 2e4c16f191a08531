#include "fem_reference/solid/elasticity.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "fem_reference/base/rigid.h"
#include "fem_reference/elements/laws.h"
#include "fem_reference/solid/implementation.h"
#include "fem_reference/solvers/distributed.h"
#include "meshing/surface/surface.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

const char* const kMotions[6] = {"shift along x", "shift along y", "shift along z",
                                 "turn about x",  "turn about y",  "turn about z"};

}  // namespace

ElasticSolid::ElasticSolid(const TetMesh& mesh, int degree)
    : self_(std::make_unique<Implementation>(mesh, degree)) {}
ElasticSolid::~ElasticSolid() = default;
ElasticSolid::ElasticSolid(ElasticSolid&&) noexcept = default;
const TetMesh& ElasticSolid::mesh() const {
  return self_->mesh;
}
const Matrix3Xd& ElasticSolid::X() const {
  return self_->nodes.X;
}
const Eigen::MatrixXi& ElasticSolid::cells() const {
  return self_->nodes.cells;
}
const Eigen::MatrixXi& ElasticSolid::faces() const {
  return self_->nodes.faces;
}
const Matrix3Xd& ElasticSolid::displacement() const {
  return self_->u;
}
int ElasticSolid::n_free_rigid_motions() const {
  return static_cast<int>(self_->rigid.cols());
}
Eigen::VectorXd ElasticSolid::load() const {
  return self_->load;
}
const std::vector<HeldComponent>& ElasticSolid::held() const {
  return self_->held;
}
double ElasticSolid::held_displacement(int k, double load_factor) const {
  return self_->held_displacement(k, load_factor);
}

void ElasticSolid::Implementation::find_rigid_motions(const Matrix3Xd& at) {
  const Eigen::MatrixXd R = rigid_motions(nodes.X + at);
  Eigen::Matrix<double, 6, 6> moved = Eigen::Matrix<double, 6, 6>::Zero();
  for (const HeldComponent& h : held) {
    const auto row = R.row(3 * h.node + h.component);
    moved += row.transpose() * row;
  }
  constexpr double kZero = 1e-10;  // squared sine of the angle at which supports hold a motion
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> eigen(moved);
  const int m = static_cast<int>((eigen.eigenvalues().array() < kZero).count());
  const Eigen::MatrixXd by_node = R * eigen.eigenvectors().leftCols(m);
  rigid.resize(by_node.rows(), m);
  for (int k = 0; k < by_node.rows(); ++k) rigid.row(space.dof_of[k]) = by_node.row(k);
  if (m > 0)
    rigid = Eigen::HouseholderQR<Eigen::MatrixXd>(rigid).householderQ() *
            Eigen::MatrixXd::Identity(rigid.rows(), m);
}

void ElasticSolid::Implementation::check_balance() const {
  Eigen::VectorXd f(load.size());
  for (int k = 0; k < load.size(); ++k) f(space.dof_of[k]) = fine.is_held[space.dof_of[k]] ? 0 : load(k);
  constexpr double kBalanced = 1e-8;  // rounding of a sum over many nodes
  if ((rigid.transpose() * f).norm() <= kBalanced * f.norm()) return;
  const Vector3d centre = nodes.X.rowwise().mean();
  Vector3d force = Vector3d::Zero(), torque = force;
  for (int i = 0; i < nodes.X.cols(); ++i) {
    force += load.segment<3>(3 * i);
    torque += (nodes.X.col(i) - centre).cross(load.segment<3>(3 * i));
  }
  const Eigen::MatrixXd motions = rigid_motions(nodes.X);
  std::ostringstream what;
  what << "the supports leave " << rigid.cols() << " rigid motions free (";
  bool is_first = true;
  for (int k = 0; k < 6; ++k) {
    Eigen::VectorXd motion(load.size());
    for (int j = 0; j < load.size(); ++j) motion(space.dof_of[j]) = motions(j, k);
    constexpr double kPart = 1e-6;
    if ((rigid.transpose() * motion).norm() < kPart * motion.norm()) continue;
    what << (is_first ? "" : ", ") << kMotions[k];
    is_first = false;
  }
  what << ") and the loads drive them: net force (" << force.transpose() << ") N, net torque ("
       << torque.transpose()
       << ") N m about the centre; expected more supports, balanced loads or "
          "reference.inertia_relief";
  throw std::runtime_error(what.str());
}

double ElasticSolid::Implementation::held_displacement(int k, double load_factor) const {
  return loads.motion ? loads.motion(k, load_factor) : load_factor * held[k].displacement;
}

void ElasticSolid::assemble(const Material& material, ElasticLaw law, const ElasticLoads& loads,
                            const std::vector<HeldComponent>& held) {
  Implementation& s = *self_;
  s.material = material;
  s.law = law;
  s.loads = loads;
  s.held = held;
  s.u.setZero();
  s.factor = 0;
  s.find_rigid_motions(s.u);
  std::fill(s.fine.is_held.begin(), s.fine.is_held.end(), false);
  if (s.coarse) std::fill(s.coarse->is_held.begin(), s.coarse->is_held.end(), false);
  for (const HeldComponent& h : held) {
    s.fine.is_held[s.space.dof_of[3 * h.node + h.component]] = true;
    if (s.coarse && h.node < s.nodes.n_vertices)
      s.coarse->is_held[s.coarse_space->dof_of[3 * h.node + h.component]] = true;
  }
  s.solver->forget();
  s.find_load();
}

void ElasticSolid::set_tolerance(double tolerance) {
  self_->tolerance = tolerance;
}

void ElasticSolid::relieve_inertia() {
  Eigen::MatrixXd motions(n_dofs(), n_free_rigid_motions());
  for (int k = 0; k < n_dofs(); ++k) motions.row(k) = self_->rigid.row(self_->space.dof_of[k]);
  const Eigen::MatrixXd momenta = mass() * motions;
  self_->load -= momenta * (motions.transpose() * momenta).ldlt().solve(motions.transpose() * self_->load);
}

double ElasticSolid::max_strain(const Matrix3Xd& displacement) const {
  ElasticReport report;
  self_->measure(displacement, self_->factor, report);
  return report.max_strain;
}

double ElasticSolid::Implementation::potential(const Matrix3Xd& at, double load_factor) const {
  ElasticReport report;
  measure(at, load_factor, report, false);
  double energy = report.elastic_energy - load_factor * load.dot(at.reshaped());
  for_each_follower(nodes.faces.rows(), at, load_factor,
                    [&](double p, const auto&, const EnclosedVolume& v) { energy += p * v.volume; });
  return energy;
}

/// Newton's method from the last equilibrium, or the one linear solve.
ElasticReport ElasticSolid::Implementation::find_equilibrium(double load_factor, StageTimer* timer) {
  const bool is_linear = law == ElasticLaw::SmallStrain;
  constexpr double kNewtonTolerance = 1e-9;
  // A step need not be more exact than Newton's method is there [Eisenstat & Walker 1996].
  constexpr double kForcing = 0.01;
  constexpr double kRounding = 1e-12, kShortestStep = 1e-4;
  constexpr int kMaxNewton = 30;
  const auto stage = [&](const char* name) {
    if (timer) timer->start(name);
  };
  ElasticReport report;
  report.tolerance = is_linear ? tolerance : kNewtonTolerance;
  Matrix3Xd at = is_linear ? Matrix3Xd::Zero(3, u.cols()) : u;
  Matrix3Xd du(3, u.cols());
  double first = 0;
  bool is_moved = false;
  // Of all forces at nodes, which are sums of stresses on the faces of elements. Measured: a third of it.
  const LameConstants lame(material);
  const auto n_nodes = static_cast<double>(u.cols());
  const double rounding = 1e-15 * (lame.lambda + 2 * lame.mu) * std::sqrt(n_nodes) *
                          std::pow(volume(mesh.X, mesh.F) / n_nodes, 2. / 3);
  for (size_t k = 0; k < held.size(); ++k) {
    const int i = 3 * held[k].node + held[k].component;
    const double move = held_displacement(static_cast<int>(k), load_factor) - at.data()[i];
    fine.prescribed(space.dof_of[i]) = move;
    is_moved = is_moved || move != 0;
  }
  for (int iteration = 0; iteration <= kMaxNewton; ++iteration) {
    stage("assemble");
    // The first step brings prescribed displacements; later ones leave them.
    if (iteration > 0) fine.prescribed.setZero();
    const Eigen::VectorXd residual = assemble_tangent(space, fine, at, load_factor);
    if (iteration == 0) first = residual.norm();
    // A step that moves nothing starts from what rounding has left, which no iteration makes less.
    const double size = is_linear ? first : std::max(first, rounding / kNewtonTolerance);
    report.residual = size > 0 ? residual.norm() / size : 0;
    report.is_converged = report.residual <= kNewtonTolerance && (iteration > 0 || !is_moved);
    if (report.is_converged) break;
    if (!is_linear) find_rigid_motions(at);
    if (coarse) assemble_tangent(*coarse_space, *coarse, at, load_factor);
    stage("solve");
    const auto solve = [&] {
      if (processes().n > 1) return solve_distributed(nodes, space, fine, rigid, residual, tolerance);
      return solver->solve(fine, coarse ? *coarse : fine, rigid, residual,
                           is_linear ? tolerance : std::clamp(kForcing * report.residual, 1e-6, kForcing));
    };
    LinearReport linear = solve();
    if (loads.follower_pressure && !(linear.is_converged && linear.x.dot(residual) > 0)) {
      // The stress that makes the tangent definite is still to come. The body's part alone also descends.
      assemble_tangent(space, fine, at, load_factor, {true, false});
      if (coarse) assemble_tangent(*coarse_space, *coarse, at, load_factor, {true, false});
      linear = solve();
    }
    if (!linear.is_definite && is_linear)
      throw std::runtime_error(
          "the stiffness matrix is not positive definite, expected supports and sound tetrahedra");
    report.solver = linear.solver;
    report.linear_iterations += linear.iterations;
    if (!linear.is_definite) return report;
    for (int k = 0; k < du.size(); ++k) {
      const unsigned i = space.dof_of[k];
      du.data()[k] = fine.is_held[i] ? fine.prescribed(i) : linear.x(i);
    }
    if (is_linear) {
      at = du;
      report.residual = linear.residual;
      report.is_converged = linear.is_converged;
      break;
    }
    ++report.newton_iterations;
    if (!linear.is_converged) return report;
    // A shorter step would miss prescribed displacements, and a full one may have to climb for them.
    const bool is_free_to_shorten = iteration > 0 || !is_moved;
    const double before = is_free_to_shorten ? potential(at, load_factor) : 0;
    // Energies are sums over the body of terms of the size of E, near which a small strain's are lost.
    const double noise = kRounding * std::abs(before) + 1e-15 * material.E * volume(mesh.X, mesh.F);
    const auto is_accepted = [&](double part) {
      const double after = potential(at + part * du, load_factor);
      return std::isfinite(after) && (!is_free_to_shorten || after <= before + noise);
    };
    double part = 1;
    while (!is_accepted(part)) {
      part /= 2;
      if (!is_free_to_shorten || part < kShortestStep) return report;
    }
    at += part * du;
  }
  if (!report.is_converged) return report;
  if (is_linear) remove_rigid_motion(at);  // a small rotation would strain a body that has moved far
  u = at;
  factor = load_factor;
  measure(u, load_factor, report);
  return report;
}

ElasticReport ElasticSolid::solve(double load_factor, StageTimer* timer) {
  Implementation& s = *self_;
  s.find_rigid_motions(Matrix3Xd::Zero(3, s.u.cols()));
  s.check_balance();
  if (s.law == ElasticLaw::SmallStrain) return s.find_equilibrium(load_factor, timer);
  constexpr double kSmallestPart = 1.0 / 64;
  const double all = load_factor - s.factor;
  double part = 1;  // of the way there
  ElasticReport total;
  do {
    const double next = s.factor + part * all;
    const bool is_last = std::abs(load_factor - s.factor) <= std::abs(part * all) * (1 + 1e-12);
    ElasticReport report = s.find_equilibrium(is_last ? load_factor : next, timer);
    report.newton_iterations += total.newton_iterations;
    report.linear_iterations += total.linear_iterations;
    total = report;
    part = report.is_converged ? std::min(1.0, 2 * part) : part / 2;
  } while (s.factor != load_factor && part >= kSmallestPart);
  return total;
}

}  // namespace testbed::fem
