#include "massspring/statics/frequencies.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "meshing/algebra/cholesky.h"
#include "meshing/algebra/lowest_modes.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::MatrixXd;

/// `apply` to every column, as a field of nodes.
template <class Apply>
MatrixXd to_each(const MatrixXd& x, const Apply& apply) {
  MatrixXd y(x.rows(), x.cols());
  for (Eigen::Index k = 0; k < x.cols(); ++k)
    y.col(k) = Matrix3Xd(apply(Matrix3Xd(x.col(k).reshaped(3, x.rows() / 3)))).reshaped();
  return y;
}

/// Of what acts on the surface at rest; pressures that follow have no part that is sure to be positive semidefinite.
meshing::SurfaceHessian hessian_at_rest(const MassSpringModel& model, const Forces& forces) {
  meshing::SurfaceHessian H;
  for (const auto& energy : surface_at(forces, initial_state(model)))
    if (!energy->is_stiff())  // contact has no finite stiffness where a body begins in touch
      energy->add_hessian(model.network.X, H, Curvature::Projected);
  return H;
}

}  // namespace

NaturalFrequencies natural_frequencies(const MassSpringModel& model, const Forces& forces, int n) {
  // Of the highest eigenvalue: far below the first elastic one, far above rounding.
  constexpr double kShift = 1e-8, kZero = 1e-12;
  BlockMatrix K = stiffness_pattern(model);
  add_stiffness(model, initial_state(model), K);
  const meshing::SurfaceHessian held = hessian_at_rest(model, forces);
  held.add_within(K);
  const BlockMatrix stiffness = K;
  double highest = 0;
  for (int i = 0; i < K.rows(); ++i)
    highest = std::max(highest, K.block[K.diagonal[i]].trace() / model.mass(i));
  const double shift = kShift * highest;
  for (int i = 0; i < K.rows(); ++i) K.block[K.diagonal[i]].diagonal().array() += shift * model.mass(i);
  if (model.consistent_mass) add_blocks(*model.consistent_mass, -shift, K);
  filter(forces.constraints, K);
  const BlockCholesky factor(K);
  if (!factor.is_ok())
    throw std::runtime_error("the stiffness has no Cholesky factor, expected a positive definite model");
  const auto filtered = [&](Matrix3Xd x) {
    filter(forces.constraints, x);
    return x;
  };
  Pencil pencil{
      [&](const MatrixXd& x) {
        return to_each(x, [&](const Matrix3Xd& u) {
          Matrix3Xd f;
          multiply(stiffness, u, f);
          return f;
        });
      },
      [&](const MatrixXd& x) { return to_each(x, [&](const Matrix3Xd& v) { return momenta(model, v); }); },
      [&](const MatrixXd& x) { return to_each(factor.solve_columns(to_each(x, filtered)), filtered); },
      3 * stiffness.rows(), kZero * highest};
  for (const Matrix3Xd& root : held.roots) {
    Matrix3Xd g = Matrix3Xd::Zero(3, stiffness.rows());
    g.leftCols(root.cols()) = root;
    pencil = with_roots(pencil, filtered(g).reshaped());
  }
  const LowestModes modes = lowest_modes(pencil, n);
  return {modes.eigenvalue.cwiseSqrt() / (2 * M_PI), modes.n_zero};
}

double damping_of_ratio(const MassSpringModel& model, const Forces& forces, double ratio) {
  const NaturalFrequencies found = natural_frequencies(model, forces, 1);
  if (found.frequency.size() == 0)
    throw std::runtime_error("material.damping_ratio = " + std::to_string(ratio) +
                             ": no motion costs energy, expected a vibration");
  return 2 * ratio * 2 * M_PI * found.frequency(0);
}

}  // namespace testbed::massspring
