#include "massspring/statics/quasi_static.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

#include "meshing/algebra/newton.h"
#include "meshing/algebra/rigid_motion.h"
#include "meshing/base/random.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

/// Those of X that leave every constrained direction at rest.
Eigen::MatrixXd free_rigid_motions_of(const Matrix3Xd& X, const std::vector<Constraint>& constraints) {
  const Eigen::MatrixXd R = rigid_motions(X);
  Eigen::Matrix<double, 6, 6> constrained = Eigen::Matrix<double, 6, 6>::Zero();
  for (const Constraint& c : constraints) {
    const Eigen::Matrix<double, 3, 6> moved =
        (Eigen::Matrix3d::Identity() - c.S) * R.middleRows<3>(3 * c.node);
    constrained += moved.transpose() * moved;
  }
  return free_rigid_motions(R, constrained);
}

constexpr double kZero = 1e-7;  // of the largest stiffness: soft motions of sound networks lie above

/// Orthonormal basis of the motions on which K does no work, 3n x m, by subspace iteration with K's shifted
/// factor.
/// @param scale  largest diagonal entry of K
Eigen::MatrixXd zero_energy_motions(const BlockMatrix& K, const BlockCholesky& factor, double scale) {
  constexpr int kIterations = 4;
  Random random(1);
  const int n = K.rows();
  for (int m = std::min(64, 3 * n);; m = std::min(2 * m, 3 * n)) {
    Eigen::MatrixXd Q(3 * n, m), KQ(3 * n, m);
    for (double& q : Q.reshaped()) q = random.uniform() - 0.5;
    for (int iteration = 0; iteration < kIterations; ++iteration) Q = orthonormal(factor.solve_columns(Q));
    Matrix3Xd y;
    for (int k = 0; k < m; ++k) {
      multiply(K, Q.col(k).reshaped(3, n), y);
      KQ.col(k) = y.reshaped();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> ritz(Q.transpose() * KQ);
    const int n_zero = static_cast<int>((ritz.eigenvalues().array() < kZero * scale).count());
    if (n_zero < m || m == 3 * n) return Q * ritz.eigenvectors().leftCols(n_zero);
  }
}

double largest_diagonal(const BlockMatrix& A) {
  double largest = 0;
  for (int i = 0; i < A.rows(); ++i) largest = std::max(largest, A.block[A.find(i, i)].diagonal().maxCoeff());
  return largest;
}

/// Whether the springs of a node alone let it move along a direction that is not constrained.
bool has_loose_node(const BlockMatrix& K, const std::vector<Constraint>& constraints) {
  std::vector<Eigen::Matrix3d> held(K.rows(), Eigen::Matrix3d::Zero());
  const double scale = largest_diagonal(K);
  for (const Constraint& c : constraints) held[c.node] = scale * (Eigen::Matrix3d::Identity() - c.S);
  for (int i = 0; i < K.rows(); ++i) {
    const Eigen::Matrix3d block = K.block[K.diagonal[i]] + held[i];
    if (Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(block, Eigen::EigenvaluesOnly).eigenvalues()(0) <
        kZero * scale)
      return true;
  }
  return false;
}

/// So that a factor exists where motions cost no energy.
BlockMatrix shifted(BlockMatrix P, const std::vector<Constraint>& constraints) {
  constexpr double kShift = 1e-8;
  const double scale = largest_diagonal(P);
  for (int i = 0; i < P.rows(); ++i) P.block[P.diagonal[i]].diagonal().array() += kShift * scale;
  filter(constraints, P);
  return P;
}

/// Orthonormal basis of the motions that the constraints leave free and on which K does no work, 3n x m.
Eigen::MatrixXd zero_energy_motions(BlockMatrix K, const std::vector<Constraint>& constraints) {
  const BlockCholesky factor(shifted(K, constraints));
  if (!factor.is_ok())
    throw std::runtime_error("the stiffness has no Cholesky factor, expected a positive definite model");
  filter(constraints, K);
  return zero_energy_motions(K, factor, largest_diagonal(K));
}

/// Orthonormal basis of what is at right angles to the columns of part in the span of those of whole, where they
/// lie; the columns of either are orthonormal.
Eigen::MatrixXd rest_of(const Eigen::MatrixXd& whole, const Eigen::MatrixXd& part) {
  const Eigen::MatrixXd Q = Eigen::HouseholderQR<Eigen::MatrixXd>(whole.transpose() * part).householderQ();
  return whole * Q.rightCols(whole.cols() - part.cols());
}

}  // namespace

std::optional<bool> has_floppy_motions(const MassSpringModel& model,
                                       const std::vector<Constraint>& constraints,
                                       double most_factor_entries) {
  if (model.tet_springs) return false;  // rigid motions are all that tetrahedra leave free
  BlockMatrix K = simple_stiffness(model, initial_state(model));
  if (has_loose_node(K, constraints)) return true;
  if (n_factor_entries(K) > most_factor_entries) return {};
  const auto n_free = zero_energy_motions(std::move(K), constraints).cols();
  return n_free > free_rigid_motions_of(model.network.X, constraints).cols();
}

QuasiStaticSolver::QuasiStaticSolver(const MassSpringModel& model, const Forces& forces, double tolerance)
    : model_(model),
      forces_(forces),
      tolerance_(tolerance),
      free_rigid_motions_(is_invariant(forces.surface)
                              ? free_rigid_motions_of(model.network.X, forces.constraints)
                              : Eigen::MatrixXd(model.network.X.size(), 0)),
      zero_energy_motions_(free_rigid_motions_),
      K_(model.linear ? BlockMatrix() : stiffness_pattern(model)),
      solver_(LinearSolver::of_stiffness(!model.tet_springs)),
      rest_{LoadPath(Matrix3Xd::Zero(3, model.network.X.cols())), {}, {}, 0, memories_of(forces.surface)} {
  check_balance(model.network.X, free_rigid_motions_, forces.load, "more supports or balanced loads");
  const State rest = initial_state(model);
  rest_.rest_length = rest.rest_length;
  rest_.patch_scale = rest.patch_scale;
  rest_.target_volume = rest.target_volume;
  if (!model.linear) add_stiffness(model, rest, K_);
  if (model.linear) row_sums_ = row_sums(model);
  largest_stiffness_ = model.linear ? row_sums_.maxCoeff() : largest_diagonal(K_);
  if (!model.tet_springs) {  // rigid motions are all that tetrahedra leave free
    zero_energy_motions_ = zero_energy_motions(stiffness(), forces.constraints);
    if (!is_invariant(forces.surface))
      zero_energy_motions_ =
          rest_of(zero_energy_motions_, free_rigid_motions_of(model.network.X, forces.constraints));
    const double load_norm = forces.load.norm();
    if (load_norm > 0)
      floppy_load_share_ = (zero_energy_motions_.transpose() * forces.load.reshaped()).norm() / load_norm;
  }
  const Eigen::Index n = model.network.X.cols(), n_motions = zero_energy_motions_.cols();
  single_zero_energy_motions_.setZero(4 * padded(n), n_motions);
  for (Eigen::Index k = 0; k < n_motions; ++k)
    for (Eigen::Index i = 0; i < n; ++i)
      single_zero_energy_motions_.col(k).segment<3>(4 * i) =
          zero_energy_motions_.col(k).segment<3>(3 * i).cast<float>();
}

/// At hand, or assembled for a linear model of coupled springs, which has none.
BlockMatrix QuasiStaticSolver::stiffness() const {
  if (!model_.linear) return K_;
  if (!model_.tet_springs) return model_.linear->K;
  BlockMatrix K = stiffness_pattern(model_);
  add_stiffness(model_, initial_state(model_), K);
  return K;
}

const BlockMatrix& QuasiStaticSolver::preconditioning_matrix(const State& state) {
  constexpr double kShift = 1e-8;  // of what a node has, so that small tetrahedra leave large ones soft
  P_ = is_exact_ || model_.material.nu > kLocks ? stiffness() : simple_stiffness(model_, state);
  surface_.add_within(P_);
  if (!model_.tet_springs) {
    P_ = shifted(std::move(P_), forces_.constraints);
    return P_;
  }
  for (const int k : P_.diagonal) P_.block[k].diagonal() *= 1 + kShift;
  filter(forces_.constraints, P_);
  return P_;
}

void QuasiStaticSolver::project(Matrix3Xd& y) const {
  filter(forces_.constraints, y);
  if (zero_energy_motions_.cols() == 0) return;
  Eigen::Map<Eigen::VectorXd> flat(y.data(), y.size());
  flat -= zero_energy_motions_ * (zero_energy_motions_.transpose() * flat).eval();
}

void QuasiStaticSolver::project(PaddedField& y) const {
  for (const Constraint& c : forces_.constraints)
    y.col(c.node).head<3>() = c.S.cast<float>() * y.col(c.node).head<3>().eval();
  if (zero_energy_motions_.cols() == 0) return;
  Eigen::Map<Eigen::VectorXf> flat(y.data(), y.size());
  flat -= single_zero_energy_motions_ * (single_zero_energy_motions_.transpose() * flat).eval();
}

/// The forces that are not balanced, and the size of those that should be, loads and internal ones.
Matrix3Xd QuasiStaticSolver::residual(const State& state, double load_factor, double& size) const {
  Matrix3Xd r;
  undamped_forces(model_, forces_, state, r, load_factor);
  const bool is_dead = forces_.surface.empty();
  size = std::abs(load_factor) * forces_.load.norm() +
         (is_dead ? (r - load_factor * forces_.load).norm() : elastic_forces(model_, state).norm());
  project(r);
  return r;
}

void QuasiStaticSolver::set_stiffness(const State& state, double load_factor, Curvature curvature) {
  K_.set_zero();
  add_stiffness(model_, state, K_, curvature);
  surface_ = surface_hessian(forces_, state, curvature, load_factor);
  single_.emplace().K = single_precision(K_);
  single_roots_ = surface_.single_roots();
  x_ = state.x;
}

void QuasiStaticSolver::product(const Matrix3Xd& p, Matrix3Xd& y) const {
  if (model_.linear)
    multiply_stiffness(model_, p, y);
  else
    multiply(K_, p, y);
  surface_.add_product(p, y);
  project(y);
}

double QuasiStaticSolver::product(const PaddedField& p, PaddedField& y) {
  if (!single_) {
    single_ = single_stiffness(model_);
    P_ = BlockMatrix();  // whose preconditioner is there by now
  }
  y.setZero(4, p.cols());
  const double p_y = model_.linear ? add_product(model_, *single_, p, y) : add_product(K_, single_->K, p, y);
  const bool is_all = surface_.empty() && zero_energy_motions_.cols() == 0;
  surface_.add_product(single_roots_, p, y);
  project(y);
  return is_all ? p_y : dot(p, y);
}

LinearSystem QuasiStaticSolver::system(const State& state) {
  LinearSystem A;
  A.product = [this](const Matrix3Xd& p, Matrix3Xd& y) { product(p, y); };
  A.single_product = [this](const PaddedField& p, PaddedField& y) { return product(p, y); };
  A.constrain = [this](Matrix3Xd& y) { filter(forces_.constraints, y); };
  A.filter = [this](Matrix3Xd& y) { project(y); };
  A.single_filter = [this](PaddedField& y) { project(y); };
  A.diagonal = [this](std::vector<Eigen::Matrix3d>& blocks) {
    blocks.clear();
    for (const int k : P_.diagonal) blocks.push_back(P_.block[k]);
  };
  A.matrix = [this, &state]() -> const BlockMatrix& { return preconditioning_matrix(state); };
  A.positions = &x_;
  return A;
}

StepReport QuasiStaticSolver::solve(double load_factor, State& state) {
  StepReport report;
  if (!state.x.allFinite()) {
    report.status = Status::Diverged;
    report.residual = std::numeric_limits<double>::quiet_NaN();
    return report;
  }
  if (!state.loading) state.loading = rest_;
  if (model_.linear) return solve_linear(load_factor, state);
  const LoadHistory from = *state.loading;
  remember(from.surface, forces_.surface);
  const State to = state;
  const double first = from.path.load_factor(), way = load_factor - first;
  State trial = state;
  const auto set_rest = [&](double factor) {
    const double part = way == 0 ? 1 : (factor - first) / way;
    if (part == 1) {
      trial.rest_length = to.rest_length;
      trial.patch_scale = to.patch_scale;
      trial.target_volume = to.target_volume;
      return;
    }
    trial.rest_length = (1 - part) * from.rest_length + part * to.rest_length;
    if (to.patch_scale.size() > 0)
      trial.patch_scale =
          part * to.patch_scale +
          (1 - part) *
              (from.patch_scale.size() > 0 ? from.patch_scale : Eigen::VectorXd::Ones(to.patch_scale.size()));
    trial.target_volume = (1 - part) * from.target_volume + part * to.target_volume;
  };
  Matrix3Xd last = state.x;          // equilibrium
  std::optional<double> stepped_to;  // load factor of the step at hand of what acts on the surface
  LoadedBody body;
  LoadHistory& history = *state.loading;
  body.prescribe = [&](double factor, Matrix3Xd& u) {
    const double from_factor = history.path.load_factor();
    if (stepped_to != factor)
      for (const auto& energy : forces_.surface) energy->begin_step(from_factor, factor - from_factor, last);
    stepped_to = factor;
    prescribe(forces_.constraints, Matrix3Xd::Zero(3, u.cols()), factor, 1, u);
  };
  body.energy = [&](double factor, const Matrix3Xd& u) {
    set_rest(factor);
    displace(u, trial);
    return potential(model_, forces_, trial, factor);
  };
  body.balance = [&](double factor, Matrix3Xd& u) {
    set_rest(factor);
    displace(u, trial);
    find_balance(factor, last, trial, report);
    u = trial.u;
    if (report.status != Status::Ok) return false;
    last = trial.x;
    stepped_to.reset();
    return true;
  };
  Matrix3Xd u = displacement(model_, state);
  if (history.path.follow(body, load_factor, u)) {
    history.rest_length = to.rest_length;
    history.patch_scale = to.patch_scale;
    history.target_volume = to.target_volume;
    history.surface = memories_of(forces_.surface);
  }
  displace(u, state);
  return report;
}

void QuasiStaticSolver::start_at(const Matrix3Xd& u, State& state) const {
  displace(u, state);
  state.loading = rest_;
  state.loading->path.last = {{1, u}};
}

void QuasiStaticSolver::set_coarser(const Eigen::Matrix2Xi& between, QuasiStaticSolver& coarser) {
  const SinglePreconditioner of_coarser = coarser.solver_.preconditioner();
  if (!of_coarser) return;
  has_coarser_ = true;
  solver_ = LinearSolver::of_halved_edges(between, of_coarser);
}

void QuasiStaticSolver::displace(const Matrix3Xd& u, State& state) const {
  state.u = u;
  state.x = model_.network.X + u;
}

/// From the last equilibrium, or a guess. Adds its iterations to the report's.
void QuasiStaticSolver::find_balance(double load_factor, const Matrix3Xd& last_x, State& state,
                                     StepReport& report) {
  constexpr double kTightest = 2e-6, kLoosest = 1e-2, kForcing = 1e-2;  // linear solves
  constexpr double kContracts = 1e-3;  // of the residual, while the matrix is kept
  constexpr double kStalls = 0.3;
  constexpr int kMaxNewton = 100;
  constexpr double kLastStep = 1e-9;  // of the body's extent, where contact is
  const SurfaceEnergies& acting = forces_.surface;
  Matrix3Xd kept_out = state.x;
  bool is_moved = false;
  for (const auto& energy : acting) is_moved |= energy->keep_out(last_x, kept_out);
  if (is_moved) {
    Matrix3Xd way = kept_out - state.x;
    filter(forces_.constraints, way);
    displace(state.u + way, state);
  }
  const Matrix3Xd start = state.u;
  const double far =
      (state.x.rowwise().maxCoeff() - state.x.rowwise().minCoeff()).norm();  // supports' motion included
  Matrix3Xd before = start;
  // Without a load, forces are what rounding makes of the stiffness: those are balanced.
  constexpr double kRounding = std::numeric_limits<double>::epsilon();
  const auto rounded = [&] {
    const Matrix3Xd& of = model_.tet_springs && n_energies(model_) == 1 ? state.u : state.x;
    return (kRounding * largest_stiffness_ * of.norm() + rounding(forces_.surface, state.x)) / tolerance_;
  };
  double scale = 0;
  double size = 0;             // of forces
  double first = 0, last = 0;  // residuals
  bool has_matrix = false, is_exact = false;

  Objective energy;
  energy.value = [&] { return potential(model_, forces_, state, load_factor); };
  energy.negative_gradient = [&](Matrix3Xd& r) { r = residual(state, load_factor, size); };
  energy.is_end = [&](const Matrix3Xd& r, NewtonReport& newton) {
    // The largest forces met on the way: those at the end vanish where supports only move a body.
    scale = std::max({scale, size, r.norm(), rounded()});
    report.residual = scale > 0 ? r.norm() / scale : 0;
    if (report.residual <= tolerance_) {
      constexpr double kLost = 0.1;
      if (r.norm() > kLost * load_factor * forces_.load.norm() && load_factor > 0 &&
          !forces_.load.isZero(0)) {
        newton.status = Status::NotConverged;
        newton.reason = "the loads drown in the rounding of positions: expected law = \"small_strain\"";
      }
      return true;
    }
    const bool is_astray = (state.u - start).colwise().norm().maxCoeff() > far;
    if (is_astray) {
      newton.status = Status::NotConverged;
      newton.reason = "the body runs away by more than its size: no equilibrium is near";
    }
    return is_astray;
  };
  energy.direction = [&](const Matrix3Xd& r, Matrix3Xd& dx) {
    const double norm = r.norm();
    if (first == 0) first = norm;
    const bool is_kept = has_matrix && norm < kContracts * last;  // and contracts as much again, not more
    // Where the residual hardly fell, what loose solves leave of soft motions may be why.
    const bool stalls = last > 0 && norm > kStalls * last;
    const double enough =
        std::max({kForcing * norm / first, tolerance_ / report.residual / 2, is_kept ? norm / last / 2 : 0});
    // A rigid motion that nothing holds takes what solves leave of it.
    const double tolerance = stalls || is_stiff(acting) ? kTightest : std::clamp(enough, kTightest, kLoosest);
    last = norm;
    const LinearSystem A = system(state);
    const auto is_solved = [&] {
      dx = Matrix3Xd::Zero(3, r.cols());
      const SolveReport linear = solver_.solve(A, r, dx, tolerance);
      report.linear_iterations += linear.iterations;
      return linear.is_converged;
    };
    if (!is_kept) {
      set_stiffness(state, load_factor, Curvature::Exact);
      is_exact = true;
    }
    has_matrix = true;
    if (is_solved() || !is_exact) return is_exact;
    // Where the Hessian is indefinite, conjugate gradients notice and stop.
    set_stiffness(state, load_factor, Curvature::Projected);
    is_exact = false;
    is_solved();
    return false;
  };
  energy.largest_step = [&](const Matrix3Xd& dx) {
    double part = 1;
    for (const auto& e : acting) part = std::min(part, e->largest_step(model_.network.X + before, dx));
    return part;
  };
  energy.move = [&](const Matrix3Xd& dx, double step) { displace(before + step * dx, state); };
  energy.accept = [&] {
    for (const auto& e : acting) e->follow(model_.network.X + before, state.x);
    before = state.u;
  };
  NewtonOptions options{kMaxNewton, largest_stiffness_ * far * far};
  if (is_stiff(acting)) options = {kMaxNewton, options.scale, kLastStep * far, false, true};
  const NewtonReport newton = minimise_constrained(
      acting, [&] { return minimise(energy, options); }, [&] { return state.x; });
  report.status = newton.status;
  report.newton_iterations += newton.iterations;
  report.reason = newton.reason;
}

}  // namespace testbed::massspring
