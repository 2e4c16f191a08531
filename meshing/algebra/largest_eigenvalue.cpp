#include "meshing/algebra/largest_eigenvalue.h"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <vector>

namespace testbed::meshing {

using Eigen::Matrix3Xd;

double largest_eigenvalue(const std::function<Matrix3Xd(const Matrix3Xd& q)>& product,
                          const Matrix3Xd& start) {
  constexpr int kMaxIterations = 60;
  constexpr double kTolerance = 1e-3;
  Matrix3Xd q = start.normalized(), q_before = Matrix3Xd::Zero(3, start.cols());
  std::vector<double> alpha, beta;
  double largest = 0;
  for (int j = 0; j < kMaxIterations; ++j) {
    Matrix3Xd r = product(q) - (j > 0 ? beta.back() : 0.) * q_before;
    alpha.push_back(r.cwiseProduct(q).sum());
    r -= alpha.back() * q;
    beta.push_back(r.norm());
    const int m = static_cast<int>(alpha.size());
    Eigen::MatrixXd T = Eigen::MatrixXd::Zero(m, m);
    for (int i = 0; i < m; ++i) {
      T(i, i) = alpha[i];
      if (i > 0) T(i, i - 1) = T(i - 1, i) = beta[i - 1];
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> ritz(T);
    const double residual = beta.back() * std::abs(ritz.eigenvectors()(m - 1, m - 1));
    largest = ritz.eigenvalues()(m - 1) + residual;  // the Ritz value alone errs on the unstable side
    if (residual <= kTolerance * largest) break;
    q_before = q;
    q = r / beta.back();
  }
  return largest;
}

}  // namespace testbed::meshing
