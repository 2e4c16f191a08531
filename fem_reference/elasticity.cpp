#include "fem_reference/elasticity.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "fem_reference/implementation.h"

namespace testbed {
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

/// The six rigid motions of the points about their mean, scaled to order 1, over 3 i + c.
static Eigen::MatrixXd rigid_motions(const Matrix3Xd& X) {
  const Vector3d centre = X.rowwise().mean();
  const double size = (X.colwise() - centre).colwise().norm().maxCoeff();
  Eigen::MatrixXd R(X.size(), 6);
  for (int i = 0; i < X.cols(); ++i) {
    R.block<3, 3>(3 * i, 0).setIdentity();
    for (int k = 0; k < 3; ++k)
      R.block<3, 1>(3 * i, 3 + k) = Vector3d::Unit(k).cross((X.col(i) - centre) / size);
  }
  return R;
}

void ElasticSolid::Implementation::find_rigid_motions() {
  const Eigen::MatrixXd R = rigid_motions(nodes.X);
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
  for (int k = 0; k < load.size(); ++k)
    f(space.dof_of[k]) = fine.constraints.is_constrained(space.dof_of[k]) ? 0 : load(k);
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
       << torque.transpose() << ") N m about the centre; expected more supports or balanced loads";
  throw std::runtime_error(what.str());
}

/// Prescribes an increment of the held components, by a part of their displacement at full load.
void ElasticSolid::Implementation::hold(double increment) {
  const auto add = [](dealii::AffineConstraints<double>& constraints, unsigned dof, double value) {
    if (!constraints.is_constrained(dof)) constraints.add_line(dof);
    constraints.set_inhomogeneity(dof, value);
  };
  fine.constraints.clear();
  coarse.constraints.clear();
  for (const HeldComponent& h : held) {
    add(fine.constraints, space.dof_of[3 * h.node + h.component], increment * h.displacement);
    if (coarse_space && h.node < nodes.n_vertices)
      add(coarse.constraints, coarse_space->dof_of[3 * h.node + h.component], 0);
  }
  fine.constraints.close();
  coarse.constraints.close();
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
  s.find_rigid_motions();
  s.hold(0);
  s.find_load();
}

double ElasticSolid::max_strain(const Matrix3Xd& displacement) const {
  ElasticReport report;
  self_->measure(displacement, self_->factor, report);
  return report.max_strain;
}

double ElasticSolid::Implementation::potential(const Matrix3Xd& at, double load_factor) const {
  ElasticReport report;
  measure(at, load_factor, report);
  return report.elastic_energy - load_factor * load.dot(at.reshaped());
}

/// Newton's method from the last equilibrium, or the one linear solve.
ElasticReport ElasticSolid::Implementation::find_equilibrium(double load_factor, StageTimer* timer) {
  const bool is_linear = law == ElasticLaw::SmallStrain;
  const bool is_moved =
      std::any_of(held.begin(), held.end(), [](const HeldComponent& h) { return h.displacement != 0; });
  constexpr double kLinearTolerance = 1e-13, kNewtonTolerance = 1e-9;
  constexpr double kRounding = 1e-12, kShortestStep = 1e-4;
  constexpr int kMaxNewton = 30;
  const auto stage = [&](const char* name) {
    if (timer) timer->start(name);
  };
  ElasticReport report;
  report.solver = degree == 2 ? "CG, two-level (SOR, P1 Cholesky)" : "CG, Cholesky";
  Matrix3Xd at = is_linear ? Matrix3Xd::Zero(3, u.cols()) : u;
  Matrix3Xd du(3, u.cols());
  DealVector residual(space.dofs.n_dofs()), step(residual);
  double first = 0;
  for (int iteration = 0; iteration <= kMaxNewton; ++iteration) {
    stage("assemble");
    // The first step brings prescribed displacements; later ones leave them.
    hold(iteration > 0 ? 0 : is_linear ? load_factor : load_factor - factor);
    residual = 0;
    assemble_tangent(space, fine, &residual, at, load_factor);
    if (iteration == 0) first = residual.l2_norm();
    report.residual = first > 0 ? residual.l2_norm() / first : 0;
    report.is_converged = report.residual <= kNewtonTolerance;
    if (report.is_converged) break;
    if (coarse_space) assemble_tangent(*coarse_space, coarse, nullptr, at, load_factor);
    stage("solve");
    if (!solver->factorise(coarse_space ? coarse : fine, rigid.cols() > 0)) {
      if (is_linear)
        throw std::runtime_error(
            "the stiffness matrix is not positive definite, expected supports and sound tetrahedra");
      return report;
    }
    const LinearReport linear = solver->solve(fine, rigid, residual, step, kLinearTolerance);
    report.linear_iterations += linear.iterations;
    fine.constraints.distribute(step);
    for (int k = 0; k < du.size(); ++k) du.data()[k] = step(space.dof_of[k]);
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
    const auto is_accepted = [&](double part) {
      const double after = potential(at + part * du, load_factor);
      return std::isfinite(after) && (!is_free_to_shorten || after <= before + kRounding * std::abs(before));
    };
    double part = 1;
    while (!is_accepted(part)) {
      part /= 2;
      if (!is_free_to_shorten || part < kShortestStep) return report;
    }
    at += part * du;
  }
  if (!report.is_converged && !is_linear) return report;
  remove_rigid_motion(at);
  u = at;
  factor = load_factor;
  measure(u, load_factor, report);
  return report;
}

ElasticReport ElasticSolid::solve(double load_factor, StageTimer* timer) {
  Implementation& s = *self_;
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
    if (!report.is_converged) part /= 2;
  } while (s.factor != load_factor && part >= kSmallestPart);
  return total;
}

}  // namespace testbed
