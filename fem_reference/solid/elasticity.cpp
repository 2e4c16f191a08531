#include "fem_reference/solid/elasticity.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "fem_reference/elements/laws.h"
#include "fem_reference/solid/divided.h"
#include "fem_reference/solid/implementation.h"
#include "meshing/algebra/rigid_motion.h"
#include "meshing/surface/surface.h"
#include "meshing/surface_energies/follower_pressure.h"

namespace testbed::fem {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

ElasticSolid::ElasticSolid(Share share, int degree)
    : self_(std::make_unique<Implementation>(std::move(share), degree)) {}
ElasticSolid::~ElasticSolid() = default;
ElasticSolid::ElasticSolid(ElasticSolid&&) noexcept = default;
ElasticSolid& ElasticSolid::operator=(ElasticSolid&&) noexcept = default;
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
const Share& ElasticSolid::share() const {
  return self_->share;
}
int ElasticSolid::n_nodes() const {
  return self_->share.is_whole ? static_cast<int>(X().cols()) : self_->share.n_nodes;
}
int ElasticSolid::n_free_rigid_motions() const {
  return static_cast<int>(self_->rigid.cols());
}
Eigen::MatrixXd ElasticSolid::rigid_motions_at_rest() const {
  Eigen::MatrixXd at_hand = self_->rigid;
  self_->find_rigid_motions(Matrix3Xd::Zero(3, self_->u.cols()));
  return std::exchange(self_->rigid, std::move(at_hand));
}
Eigen::VectorXd ElasticSolid::load() const {
  return self_->load;
}
const meshing::SurfaceEnergies& ElasticSolid::surface() const {
  return self_->surface;
}
const std::vector<ConstrainedComponent>& ElasticSolid::constrained() const {
  return self_->constrained;
}
double ElasticSolid::constrained_displacement(int k, double load_factor) const {
  return self_->constrained_displacement(k, load_factor);
}

void ElasticSolid::Implementation::find_rigid_motions(const Matrix3Xd& at) {
  if (!is_invariant(surface)) {  // what touches the body holds it
    rigid.resize(3 * at.cols(), 0);
    return;
  }
  const Eigen::MatrixXd R = share.rigid_motions(nodes.X + at);
  Eigen::Matrix<double, 6, 6> moved = Eigen::Matrix<double, 6, 6>::Zero();
  for (const ConstrainedComponent& h : constrained) {
    if (!share.is_whole && share.is_ghost[h.node]) continue;
    const auto row = R.row(3 * h.node + h.component);
    moved += row.transpose() * row;
  }
  if (share.is_whole) {
    rigid = free_rigid_motions(R, moved);
    return;
  }
  sum_over_processes(moved.reshaped());
  rigid = R * meshing::free_combinations(moved);
  Eigen::MatrixXd products = Eigen::MatrixXd::Zero(rigid.cols(), rigid.cols());
  for (Eigen::Index i = 0; i < at.cols(); ++i)
    if (!share.is_ghost[i]) products += rigid.middleRows<3>(3 * i).transpose() * rigid.middleRows<3>(3 * i);
  sum_over_processes(products.reshaped());
  products.llt().matrixU().solveInPlace<Eigen::OnTheRight>(rigid);
}

void ElasticSolid::Implementation::check_balance() const {
  constexpr const char* kExpected = "more supports, balanced loads or reference.inertia_relief";
  if (share.is_whole) return meshing::check_balance(nodes.X, rigid, load.reshaped(3, u.cols()), kExpected);
  Eigen::VectorXd driven = rigid.transpose() * load;
  sum_over_processes(driven);
  const Matrix3Xd forces = load.reshaped(3, u.cols());
  if (driven.norm() <= meshing::kBalanced * share.norm(forces)) return;
  const int n = share.n_nodes;
  const Matrix3Xd X = share.gather(nodes.X, n), whole = share.gather(forces, n);
  Eigen::MatrixXd motions(X.size(), rigid.cols());
  for (Eigen::Index k = 0; k < rigid.cols(); ++k)
    motions.col(k) = share.gather(rigid.col(k).reshaped(3, u.cols()), n).reshaped();
  if (processes().rank == 0) meshing::check_balance(X, motions, whole, kExpected);
  throw std::runtime_error("loads drive free rigid motions");  // the first process says more
}

double ElasticSolid::Implementation::constrained_displacement(int k, double load_factor) const {
  return loads.motion ? loads.motion(k, load_factor) : load_factor * constrained[k].displacement;
}

void ElasticSolid::Implementation::prescribe(double load_factor, Matrix3Xd& at) const {
  for (size_t k = 0; k < constrained.size(); ++k)
    at(constrained[k].component, constrained[k].node) =
        constrained_displacement(static_cast<int>(k), load_factor);
}

void ElasticSolid::assemble(const Material& material, ElasticLaw law, const ElasticLoads& loads,
                            const std::vector<ConstrainedComponent>& constrained, double kappa) {
  Implementation& s = *self_;
  s.material = material;
  s.lame = LameConstants(material);
  s.lame.kappa = kappa;
  s.law = law;
  s.loads = loads;
  s.surface = {};
  if (loads.follower_pressure) {
    Eigen::VectorXd pressure(s.nodes.faces.cols());
    for (int f = 0; f < pressure.size(); ++f)
      pressure(f) = loads.follower_pressure(s.share.is_whole ? f : s.share.face[f]);
    s.surface = meshing::followers_of(pressure, s.nodes.faces);
    if (!s.share.is_whole) s.surface = {std::make_shared<DividedPressure>(s.surface, s.share)};
  }
  s.surface.insert(s.surface.end(), loads.surface.begin(), loads.surface.end());
  s.stepped_to.reset();
  s.constrained = constrained;
  s.u.setZero();
  s.factor = 0;
  s.path.emplace(s.u);
  s.constant.reset();
  s.row_sums.resize(0);
  s.shrunk_at = -1;
  s.is_constrained.assign(s.nodes.X.size(), false);
  for (const ConstrainedComponent& h : constrained) s.is_constrained[3 * h.node + h.component] = true;
  s.constrained_rows = rows_of(s.tets, s.is_constrained);
  s.tets.set_law(law, s.lame, s.rule(s.degree));
  if (s.corners) {
    s.constrained_corner_rows = rows_of(*s.corners, s.is_constrained);
    s.corners->set_law(law, s.lame, s.rule(1));
  }
  s.solver.hold(s.is_constrained);
  s.find_rigid_motions(s.u);
  s.find_load();
}

ElasticState ElasticSolid::state() const {
  return {self_->u, self_->factor, *self_->path, memories_of(self_->surface)};
}

void ElasticSolid::set_state(const ElasticState& state) {
  self_->u = state.u;
  self_->factor = state.load_factor;
  self_->path = state.path;
  remember(state.surface, self_->surface);
  self_->stepped_to.reset();
}

void ElasticSolid::set_shrinkage(const Eigen::VectorXd& s) {
  self_->tets.interpolate_shrinkage(s);
}

void ElasticSolid::set_tolerance(double tolerance) {
  self_->tolerance = tolerance;
}

void ElasticSolid::relieve_inertia() {
  const Eigen::MatrixXd& motions = self_->rigid;
  const Eigen::MatrixXd momenta = mass() * motions;
  Eigen::MatrixXd inertia = motions.transpose() * momenta;
  Eigen::VectorXd driven = motions.transpose() * self_->load;
  sum_over_processes(inertia.reshaped());
  sum_over_processes(driven);
  self_->load -= momenta * inertia.ldlt().solve(driven);
}

double ElasticSolid::max_strain(const Matrix3Xd& displacement) const {
  return self_->max_strain(displacement);
}

bool ElasticSolid::Implementation::is_balanced(const Matrix3Xd& at, double residual) {
  constexpr double kLinear = 1e-13, kNewton = 1e-10;
  report.tolerance = tolerance.value_or(law == ElasticLaw::SmallStrain ? kLinear : kNewton);
  report.residual = size > 0 ? residual / size : 0;
  // Forces at nodes are sums of stresses on the faces of elements, of differences of displacements. Rounding of
  // these is what no solver makes less [Rigal & Gaches 1967].
  const double h = std::cbrt(share.volume / static_cast<double>(share.is_whole ? at.cols() : share.n_nodes));
  const double u = share.norm(at);
  const double rounding = 1e-15 * (lame.lambda + 2 * lame.mu + lame.kappa) * h * u;
  const double of_surface =
      surface.empty() ? 0 : largest_over_processes(meshing::rounding(surface, nodes.X + at));
  report.is_converged = residual <= std::max(report.tolerance * size, rounding + of_surface);
  return report.is_converged;
}

/// Sums of the norms of blocks in each row of A, by node (N/m).
Eigen::VectorXd ElasticSolid::Implementation::row_sums_of(const TwoLevelSolver::Stiffness& A) const {
  const meshing::BlockMatrix& pattern = tets.pattern();
  Eigen::VectorXd sums(u.cols());
  for (Eigen::Index i = 0; i < u.cols(); ++i) {
    const int row = tets.rank()[i];
    sums[i] = 0;
    for (int k = pattern.row_start[row]; k < pattern.row_start[row + 1]; ++k)
      sums[i] += Eigen::Matrix3f::Map(&A.blocks[9 * static_cast<std::size_t>(k)]).norm();
  }
  return sums;
}

/// |r| of nodes where it is more than rounding leaves of forces, which is told node by node: that of flat tetrahedra may
/// be more than all loads.
double ElasticSolid::Implementation::norm_beyond_rounding(const Matrix3Xd& at, const Matrix3Xd& r) const {
  if (row_sums.size() == 0) return share.norm(r);
  constexpr double kRounding =
      16 * std::numeric_limits<double>::epsilon();  // of sums of some hundred products at four points
  const double largest = largest_over_processes(at.colwise().norm().maxCoeff());
  const Eigen::RowVectorXd bound = kRounding * largest * row_sums.transpose();
  return share.norm(r * (r.colwise().norm().array() <= bound.array())
                            .select(0, Eigen::RowVectorXd::Ones(r.cols()))
                            .matrix()
                            .asDiagonal());
}

/// Iterative refinement: the residual in double precision by the elements, corrections in single. Where these stand
/// still, beside slivers, corrections in double precision as well.
void ElasticSolid::Implementation::solve_linear(double load_factor, StageTimer* timer) {
  constexpr int kMaxRefinements = 30;
  constexpr double kDeepest = 1e-5, kLost = 0.5;
  const auto stage = [&](const char* name) {
    if (timer) timer->start(name);
  };
  Matrix3Xd at = Matrix3Xd::Zero(3, u.cols()), last = at, r;
  prescribe(load_factor, at);
  double before = std::numeric_limits<double>::infinity(), given = 0;
  Matrix3Xd balanced = load.reshaped(3, u.cols());
  remove_rigid(balanced);
  const Matrix3Xd driving = load.reshaped(3, u.cols()) - balanced;
  const auto measure = [&] {
    size = given;  // and not what a lost correction led to
    find_residual(at, load_factor, r);
    r -= load_factor * driving;
    if (given == 0) given = size;
  };
  bool is_in_double = solver.has_whole_factor(), is_still = false;
  for (int refinement = 0; refinement < kMaxRefinements; ++refinement) {
    stage("assemble");
    measure();
    if (norm_beyond_rounding(at, r) > before) {
      at = last;
      measure();
    }
    const double residual = norm_beyond_rounding(at, r);
    if (is_balanced(at, residual)) break;
    const double wanted = 0.5 * report.tolerance * size / share.norm(r);
    if (!constant) {
      constant = stiffness_at(Matrix3Xd::Zero(3, u.cols()), 0, meshing::Curvature::Projected);
      hold(*constant);
      row_sums = row_sums_of(*constant);
    }
    stage("solve");
    if (is_still || residual > kLost * before) {
      if (is_in_double) break;
      is_in_double = true;
      is_still = false;
      solver.turn_to_factor(*constant, rigid.cols() > 0);
    }
    before = residual;
    last = at;
    if (is_in_double) {
      iterate_in_double(r, wanted, at);
      continue;
    }
    const LinearReport linear =
        solver.solve(*constant, rigid, r, std::max(kDeepest, wanted), at, /*may_turn=*/false);
    is_still = !linear.is_converged;
    share.exchange.update(at);
    if (!linear.is_definite)
      throw std::runtime_error(
          "the stiffness matrix is not positive definite, expected supports and sound tetrahedra");
    report.solver = linear.solver;
    report.linear_iterations += linear.iterations;
  }
  report.residual = size > 0 ? share.norm(r) / size : 0;
  if (!report.is_converged) return;
  remove_rigid_motion(at);  // a small rotation would strain a body that has moved far
  u = at;
  factor = load_factor;
}

void ElasticSolid::Implementation::remove_rigid(Matrix3Xd& forces) const {
  Eigen::VectorXd parts = rigid.transpose() * forces.reshaped();
  sum_over_processes(parts);
  forces.reshaped() -= rigid * parts;
  share.clear_ghosts(forces);
}

/// Adds to x the solution of K x = r by conjugate gradients in double precision, whose products are forces.
void ElasticSolid::Implementation::iterate_in_double(const Matrix3Xd& r, double relative, Matrix3Xd& x) {
  constexpr int kMaxIterations = 2000;
  for (TetBatches* on : {&tets, corners ? &*corners : nullptr})
    if (on) on->set_shrinkage({});
  shrunk_at = -1;
  const auto restrict_to_free = [&](Matrix3Xd& y) {
    for (Eigen::Index k = 0; k < y.size(); ++k)
      if (is_constrained[k]) y.data()[k] = 0;
    share.clear_ghosts(y);
    remove_rigid(y);
  };
  Summed<Matrix3Xd> rest(r), solution(Matrix3Xd::Zero(3, r.cols()));
  restrict_to_free(rest);
  const meshing::SolveReport done = meshing::conjugate_gradients(
      [&](const Matrix3Xd& p, Matrix3Xd& y) {
        Matrix3Xd moved = p;
        share.exchange.update(moved);
        tets.forces(moved, y);
        restrict_to_free(y);
      },
      solver.preconditioner(*constant, rigid), rest, share.norm(r), solution, relative, kMaxIterations);
  report.solver = solver.name() + ", double precision";
  report.linear_iterations += done.iterations;
  x += solution;
  share.exchange.update(x);
}

/// What iterations leave of rigid motions would move far a body that nothing holds in some directions: their
/// part of dx is the one that balances r on them.
void ElasticSolid::Implementation::balance_rigid_motions(const TwoLevelSolver::Stiffness& A,
                                                         const Matrix3Xd& at, const Matrix3Xd& r,
                                                         Matrix3Xd& dx) const {
  Eigen::MatrixXd R = share.rigid_motions(nodes.X + at);
  for (Eigen::Index k = 0; k < R.rows(); ++k)
    if (is_constrained[k] || (!share.is_whole && share.is_ghost[k / 3])) R.row(k).setZero();
  Matrix3Xd rest = r;
  solver.add_product(A, -1, dx, rest);
  Eigen::MatrixXd AR(R.rows(), R.cols());
  for (Eigen::Index k = 0; k < R.cols(); ++k) {
    Matrix3Xd product = Matrix3Xd::Zero(3, r.cols());
    solver.add_product(A, 1, R.col(k).reshaped(3, r.cols()), product);
    AR.col(k) = product.reshaped();
  }
  Eigen::MatrixXd K = R.transpose() * AR;
  Eigen::VectorXd f = R.transpose() * rest.reshaped();
  sum_over_processes(K.reshaped());
  sum_over_processes(f);
  const Eigen::VectorXd part = K.ldlt().solve(f);
  if (part.allFinite()) dx.reshaped() += R * part;
}

/// Newton's direction, or one that descends as well. Returns whether it is Newton's.
bool ElasticSolid::Implementation::solve_direction(const Matrix3Xd& at, double load_factor,
                                                   const Matrix3Xd& r, double relative, Matrix3Xd& dx) {
  find_rigid_motions(at);
  const auto solve = [&](meshing::Curvature curvature) {
    TwoLevelSolver::Stiffness A = stiffness_at(at, load_factor, curvature);
    hold(A);
    dx = Matrix3Xd::Zero(3, r.cols());
    const LinearReport linear = solver.solve(A, rigid, r, relative, dx);
    report.solver = linear.solver;
    report.linear_iterations += linear.iterations;
    if (is_stiff(surface)) balance_rigid_motions(A, at, r, dx);
    share.exchange.update(dx);
    return linear.is_definite;
  };
  if (solve(meshing::Curvature::Exact)) return true;
  // The stress that makes the tangent definite is still to come. The body's part alone also descends.
  if (!surface.empty()) solve(meshing::Curvature::Projected);
  return false;
}

/// Where supports move from the last equilibrium, x follows them by the tangent there.
void ElasticSolid::Implementation::follow_supports(double load_factor, Matrix3Xd& x) {
  constexpr double kRough = 1e-3;
  Matrix3Xd moved = x - u, r;
  double of_supports = 0, of_others = 0;
  for (Eigen::Index k = 0; k < moved.size(); ++k) {
    double& largest = is_constrained[k] ? of_supports : of_others;
    largest = std::max(largest, std::abs(moved.data()[k]));
  }
  if (largest_over_processes(of_supports) == 0) return;
  if (largest_over_processes(of_others) > 0) return;  // predicted from earlier equilibria
  find_rigid_motions(u);
  find_residual(u, load_factor, r);
  TwoLevelSolver::Stiffness A = stiffness_at(u, load_factor, meshing::Curvature::Exact);
  solver.add_product(A, -1, moved, r);
  for (Eigen::Index k = 0; k < r.size(); ++k)
    if (is_constrained[k]) r.data()[k] = 0;
  hold(A);
  const LinearReport linear = solver.solve(A, rigid, r, kRough, x);
  share.exchange.update(x);
  report.solver = linear.solver;
  report.linear_iterations += linear.iterations;
  ++report.newton_iterations;
}

/// Once, however often a guess is looked at.
void ElasticSolid::Implementation::begin_step(double load_factor) {
  if (stepped_to == load_factor) return;
  stepped_to = load_factor;
  for (const auto& energy : surface) energy->begin_step(factor, load_factor - factor, nodes.X + u);
}

/// Takes a guess of free unknowns out of what the surface must not enter, coming from the last equilibrium.
void ElasticSolid::Implementation::keep_out(Matrix3Xd& x) const {
  Matrix3Xd y = nodes.X + x;
  bool is_moved = false;
  for (const auto& energy : surface) is_moved |= energy->keep_out(nodes.X + u, y);
  for (Eigen::Index k = 0; is_moved && k < x.size(); ++k)
    if (!is_constrained[k]) x.data()[k] = y.data()[k] - nodes.X.data()[k];
}

bool ElasticSolid::Implementation::balance(double load_factor, Matrix3Xd& x, StageTimer* timer) {
  constexpr double kForcing = 0.01, kDeepest = 2e-6;  // [Eisenstat & Walker 1996]
  constexpr int kMaxNewton = 30, kMaxNewtonOfContact = 100;
  constexpr double kLastStep = 1e-9;  // of the body's extent
  const auto stage = [&](const char* name) {
    if (timer) timer->start(name);
  };
  stage("solve");
  size = 0;
  report.is_converged = false;
  begin_step(load_factor);
  follow_supports(load_factor, x);
  keep_out(x);
  if (!std::isfinite(potential(x, load_factor))) return false;
  const Matrix3Xd guess = x;
  const double extent = diagonal_over_processes(nodes.X);
  // Contact is so stiff that the rounding of positions is no balance of forces: the last correction tells then.
  const bool is_stiff = meshing::is_stiff(surface);
  Matrix3Xd start = x;
  double first = 0, residual = 0;
  meshing::Objective objective;
  objective.dot = [&](const Matrix3Xd& a, const Matrix3Xd& b) { return share.dot(a, b); };
  objective.longest = [](const Matrix3Xd& a) {
    return largest_over_processes(a.colwise().norm().maxCoeff());
  };
  objective.value = [&] { return potential(x, load_factor); };
  objective.negative_gradient = [&](Matrix3Xd& r) {
    find_residual(x, load_factor, r);
    find_rigid_motions(x);
    remove_rigid(r);
  };
  report.is_definite = true;
  objective.is_end = [&](const Matrix3Xd& r, meshing::NewtonReport& newton) {
    // Downhill of a saddle lies another path: shorter load steps keep to this one.
    if (!report.is_definite && surface.empty()) newton.status = meshing::Status::NotConverged;
    if (newton.status != meshing::Status::Ok) return true;
    residual = share.norm(r);
    first = std::max(first, residual);
    // Nothing holds the body any more.
    if (is_stiff && objective.longest(x - guess) > extent) newton.status = meshing::Status::NotConverged;
    return newton.status != meshing::Status::Ok || is_balanced(x, residual);
  };
  objective.direction = [&](const Matrix3Xd& r, Matrix3Xd& dx) {
    report.is_definite =
        solve_direction(x, load_factor, r, std::clamp(kForcing * residual / first, kDeepest, kForcing), dx);
    return report.is_definite;
  };
  objective.largest_step = [&](const Matrix3Xd& dx) {
    double part = 1;
    for (const auto& energy : surface) part = std::min(part, energy->largest_step(nodes.X + start, dx));
    return part;
  };
  objective.move = [&](const Matrix3Xd& dx, double step) { x = start + step * dx; };
  objective.accept = [&] {
    for (const auto& energy : surface) energy->follow(nodes.X + start, nodes.X + x);
    start = x;
  };
  const meshing::NewtonOptions options{is_stiff ? kMaxNewtonOfContact : kMaxNewton, material.E * share.volume,
                                       is_stiff ? kLastStep * extent : 0, false, is_stiff};
  const meshing::NewtonReport newton = minimise_constrained(
      surface, [&] { return minimise(objective, options); }, [&]() -> Matrix3Xd { return nodes.X + x; });
  report.newton_iterations += newton.iterations;
  report.is_converged = newton.status == meshing::Status::Ok && (is_balanced(x, residual) || is_stiff);
  if (!report.is_converged) return false;
  u = x;
  factor = load_factor;
  stepped_to.reset();
  return true;
}

ElasticReport ElasticSolid::solve(double load_factor, StageTimer* timer) {
  Implementation& s = *self_;
  s.find_rigid_motions(Matrix3Xd::Zero(3, s.u.cols()));
  if (is_invariant(s.surface)) s.check_balance();
  s.report = {};
  s.size = 0;
  if (s.law == ElasticLaw::SmallStrain && s.surface.empty()) {
    s.solve_linear(load_factor, timer);
  } else {
    Matrix3Xd x = s.u;
    s.path->follow({[&](double next, Matrix3Xd& at) {
                      s.begin_step(next);
                      s.prescribe(next, at);
                    },
                    [&](double next, const Matrix3Xd& at) { return s.potential(at, next); },
                    [&](double next, Matrix3Xd& at) { return s.balance(next, at, timer); }},
                   load_factor, x);
  }
  if (!s.report.is_converged) return s.report;
  s.shrink(load_factor);
  s.report.elastic_energy = sum_over_processes(s.tets.energy(s.u));
  s.report.max_strain = s.max_strain(s.u);
  return s.report;
}

}  // namespace testbed::fem
