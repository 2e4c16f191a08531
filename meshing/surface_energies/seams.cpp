#include "meshing/surface_energies/seams.h"

#include <algorithm>

namespace testbed::meshing {

Seams seams_of(const SurfaceProblem& problem) {
  const auto m = static_cast<Eigen::Index>(problem.stitches.size());
  Seams seams{Eigen::Matrix2Xi(2, m), Eigen::VectorXd(m)};
  for (Eigen::Index s = 0; s < m; ++s) {
    const auto& [a, b, stiffness] = problem.stitches[s];
    seams.E.col(s) << a, b;
    seams.stiffness(s) = stiffness;
  }
  return seams;
}

double energy(const Seams& seams, const Eigen::Matrix3Xd& x) {
  double sum = 0;
  for (Eigen::Index s = 0; s < seams.E.cols(); ++s)
    sum += seams.stiffness(s) / 2 * (x.col(seams.E(0, s)) - x.col(seams.E(1, s))).squaredNorm();
  return sum;
}

void add_forces(const Seams& seams, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) {
  for (Eigen::Index s = 0; s < seams.E.cols(); ++s) {
    const int a = seams.E(0, s), b = seams.E(1, s);
    const Eigen::Vector3d pull = seams.stiffness(s) * (x.col(b) - x.col(a));
    f.col(a) += pull;
    f.col(b) -= pull;
  }
}

void add_hessian(const Seams& seams, const Eigen::Matrix3Xd&, BlockMatrix& K, Curvature) {
  for (Eigen::Index s = 0; s < seams.E.cols(); ++s) {
    const int a = seams.E(0, s), b = seams.E(1, s);
    for (const int k : {K.diagonal[a], K.diagonal[b]}) K.block[k].diagonal().array() += seams.stiffness(s);
    K.block[K.find(std::min(a, b), std::max(a, b))].diagonal().array() -= seams.stiffness(s);
  }
}

void add_hessian(const Seams& seams, const Eigen::Matrix3Xd&, SurfaceHessian& H, Curvature) {
  for (Eigen::Index s = 0; s < seams.E.cols(); ++s) {
    const int a = seams.E(0, s), b = seams.E(1, s);
    const Eigen::Matrix3d k = seams.stiffness(s) * Eigen::Matrix3d::Identity();
    for (const int node : {a, b}) H.blocks.push_back({node, node, k});
    H.blocks.push_back({a, b, -k});
  }
}

Eigen::Matrix2Xi pairs_of(const Seams& seams) {
  return seams.E;
}

}  // namespace testbed::meshing
