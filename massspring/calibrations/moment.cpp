// Moment fit. Springs k_s of direction n and length l, s = (i, j), are wanted such that at every node i
//   linear fields are balanced:      sum_j k l n n n = b_i, 0 inside, on the surface -mu A_i (N_a d_bc + N_b
//   d_ac + N_c d_ab), quadratic fields, softly:        sum_j k l^2 n n n n = mu (sum over the 6 pairings of
//   d_ab H_cd),
//                                    H_i = V_i I - sym(integral of N_i (x - x_i) n dA),
// which are 10 and 15 rows. Unknown is q = k/k_affine >= 0:  min |A q - b|^2/(2 rho) + |q - 1|^2/2. Its dual
// y has q = max(0, 1 + A^T y) and the optimality condition rho y + A q(y) = b, solved by semismooth Newton.
#include <Eigen/Geometry>
#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "massspring/calibrations/calibrations.h"
#include "massspring/statics/linear_statics.h"
#include "meshing/algebra/conjugate_gradients.h"

namespace testbed::massspring {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr int kMostNeighbours = 45;
constexpr double kQuadraticWeight = 0.1;  // soft beside the linear rows
constexpr double kRho = 1e-4;
constexpr int kLinearRows = 10, kRows = 25;

/// Index triples and quadruples a <= b <= c (<= d) of symmetric tensors.
const std::vector<std::array<int, 4>>& moments() {
  static const std::vector<std::array<int, 4>> kAll = [] {
    std::vector<std::array<int, 4>> result;
    for (int a = 0; a < 3; ++a)
      for (int b = a; b < 3; ++b)
        for (int c = b; c < 3; ++c) result.push_back({a, b, c, -1});
    for (int a = 0; a < 3; ++a)
      for (int b = a; b < 3; ++b)
        for (int c = b; c < 3; ++c)
          for (int d = c; d < 3; ++d) result.push_back({a, b, c, d});
    return result;
  }();
  return kAll;
}

/// Pairs of nodes within two tetrahedra edges, each node's nearest ones.
Eigen::Matrix2Xi candidate_springs(const TetMesh& network) {
  const int n = static_cast<int>(network.X.cols());
  std::vector<std::set<int>> next(n);
  for (const auto& t : network.T.colwise())
    for (int i : t)
      for (int j : t)
        if (i != j) next[i].insert(j);
  std::set<std::pair<int, int>> pairs;
  for (int i = 0; i < n; ++i) {
    std::set<int> near = next[i];
    for (int j : next[i]) near.insert(next[j].begin(), next[j].end());
    near.erase(i);
    std::vector<std::pair<double, int>> by_distance;
    for (int j : near) by_distance.emplace_back((network.X.col(i) - network.X.col(j)).squaredNorm(), j);
    std::sort(by_distance.begin(), by_distance.end());
    if (by_distance.size() > kMostNeighbours) by_distance.resize(kMostNeighbours);
    for (const auto& [distance, j] : by_distance) pairs.insert(std::minmax(i, j));
  }
  Eigen::Matrix2Xi E(2, pairs.size());
  int s = 0;
  for (const auto& [i, j] : pairs) E.col(s++) << i, j;
  return E;
}

struct Fit {
  Eigen::SparseMatrix<double, Eigen::RowMajor> A;
  VectorXd b;
};

/// Rows over mu times a power of the node's volume, so that they have no unit; columns times k_affine.
Fit moment_rows(const TetMesh& network, const Eigen::Matrix2Xi& E, const VectorXd& k_affine, double mu) {
  const Eigen::Matrix3Xd& X = network.X;
  const int n = static_cast<int>(X.cols());
  const VectorXd V = lumped_mass(X, network.T, 1);
  std::vector<Vector3d> area(n, Vector3d::Zero());
  std::vector<Matrix3d> H(n);
  for (int i = 0; i < n; ++i) H[i] = V[i] * Matrix3d::Identity();
  for (const auto& t : network.F.colwise()) {
    const Vector3d a = (X.col(t[1]) - X.col(t[0])).cross(X.col(t[2]) - X.col(t[0])) / 2;
    for (int k = 0; k < 3; ++k) {
      const Vector3d m = (X.col(t[(k + 1) % 3]) + X.col(t[(k + 2) % 3]) - 2 * X.col(t[k])) / 12;
      area[t[k]] += a / 3;
      H[t[k]] -= (m * a.transpose() + a * m.transpose()) / 2;
    }
  }
  const auto delta = [](int a, int b) { return a == b ? 1. : 0.; };
  Fit fit;
  fit.b.resize(kRows * n);
  std::vector<Eigen::Triplet<double>> entries;
  const VectorXd linear_scale = (mu * V.array().pow(2. / 3)).inverse(),
                 quadratic_scale = kQuadraticWeight / (mu * V.array());
  for (int i = 0; i < n; ++i)
    for (int r = 0; r < kRows; ++r) {
      const auto& [a, b, c, d] = moments()[r];
      fit.b[kRows * i + r] =
          r < kLinearRows
              ? -linear_scale[i] * mu *
                    (area[i][a] * delta(b, c) + area[i][b] * delta(a, c) + area[i][c] * delta(a, b))
              : quadratic_scale[i] * mu *
                    (delta(a, b) * H[i](c, d) + delta(a, c) * H[i](b, d) + delta(a, d) * H[i](b, c) +
                     delta(b, c) * H[i](a, d) + delta(b, d) * H[i](a, c) + delta(c, d) * H[i](a, b));
    }
  for (int s = 0; s < E.cols(); ++s)
    for (int end = 0; end < 2; ++end) {
      const int i = E(end, s);
      const Vector3d l = X.col(E(1 - end, s)) - X.col(i), n_s = l.normalized();
      for (int r = 0; r < kRows; ++r) {
        const auto& [a, b, c, d] = moments()[r];
        const double value = r < kLinearRows ? linear_scale[i] * l[a] * n_s[b] * n_s[c]
                                             : quadratic_scale[i] * l[a] * l[b] * n_s[c] * n_s[d];
        entries.emplace_back(kRows * i + r, s, value * k_affine[s]);
      }
    }
  fit.A.resize(kRows * n, E.cols());
  fit.A.setFromTriplets(entries.begin(), entries.end());
  return fit;
}

/// Solves (rho I + A D A^T) d = r by conjugate gradients, D the active columns.
VectorXd newton_direction(const Fit& fit, const VectorXd& active, const VectorXd& r) {
  constexpr double kTolerance = 1e-3;
  constexpr int kMaxIterations = 2000;
  VectorXd diagonal = VectorXd::Constant(r.size(), kRho);
  for (int row = 0; row < r.size(); ++row)
    for (decltype(fit.A)::InnerIterator a(fit.A, row); a; ++a)
      diagonal[row] += active[a.col()] * a.value() * a.value();
  const auto product = [&](const VectorXd& p, VectorXd& y) {
    const VectorXd weighted = active.cwiseProduct(fit.A.transpose() * p);
    y = kRho * p + fit.A * weighted;
  };
  const auto precondition = [&](const VectorXd& v, VectorXd& z) { z = v.cwiseQuotient(diagonal); };
  VectorXd d = VectorXd::Zero(r.size()), residual = r;
  conjugate_gradients(product, precondition, residual, r.norm(), d, kTolerance, kMaxIterations);
  return d;
}

/// q >= 0. @throws std::runtime_error when the iteration does not converge.
VectorXd fit_non_negative(const Fit& fit) {
  constexpr double kTolerance = 1e-6;
  constexpr int kMaxNewton = 60, kMaxHalvings = 20;
  const auto primal = [&](const VectorXd& y) {
    return (1 + (fit.A.transpose() * y).array()).max(0).matrix().eval();
  };
  const auto dual = [&](const VectorXd& y) {
    return kRho / 2 * y.squaredNorm() + primal(y).squaredNorm() / 2 - fit.b.dot(y);
  };
  VectorXd y = VectorXd::Zero(fit.b.size());
  double residual = 0;
  for (int iteration = 0; iteration < kMaxNewton; ++iteration) {
    const VectorXd q = primal(y), r = fit.b - kRho * y - fit.A * q;
    residual = r.norm() / fit.b.norm();
    if (residual < kTolerance) return q;
    const VectorXd d = newton_direction(fit, (q.array() > 0).cast<double>(), r);
    double step = 1;
    for (int halving = 0; halving < kMaxHalvings && dual(y + step * d) > dual(y) - 1e-4 * step * r.dot(d);
         ++halving)
      step /= 2;
    y += step * d;
  }
  throw std::runtime_error(
      "network.calibration = 'moment': the fit of non-negative stiffnesses did not converge (residual " +
      std::to_string(residual) + "), expected a more even mesh or another model");
}

}  // namespace

/// Springs between nodes at most two tetrahedra edges apart, and a dilatation term at nodes for nu > 1/4.
/// Stiffnesses k >= 0 fit the moments that linear and, softly, quadratic fields must balance
/// at every node [(18)].
/// @throws std::runtime_error when no non-negative k fits.
void calibrate_moment(MassSpringModel& model, const Eigen::Matrix2Xi&) {
  const double mu = lame_of(model.material).mu;
  const TetMesh& network = model.network;
  const Eigen::Matrix2Xi E = candidate_springs(network);
  const VectorXd V = lumped_mass(network.X, network.T, 1);
  VectorXd degree = VectorXd::Zero(V.size());
  for (int i : E.reshaped()) ++degree[i];
  VectorXd k_affine =
      15 * mu * squared_lengths(network.X, E).cwiseInverse();  // times the spring's share of volume
  for (int s = 0; s < E.cols(); ++s)
    k_affine[s] *= V[E(0, s)] / degree[E(0, s)] + V[E(1, s)] / degree[E(1, s)];

  const VectorXd q = fit_non_negative(moment_rows(network, E, k_affine, mu));
  std::vector<int> used;
  for (int s = 0; s < q.size(); ++s)
    if (q[s] > 0) used.push_back(s);
  set_springs(model, E(Eigen::all, used), q(used).cwiseProduct(k_affine(used)));
  add_dilatation(model);
  LinearStatics(model, hold_rigid_motion(network.X));  // refuses what is not positive definite
}

}  // namespace testbed::massspring
