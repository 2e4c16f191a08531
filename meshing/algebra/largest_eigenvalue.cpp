#include "meshing/algebra/largest_eigenvalue.h"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <vector>

namespace testbed::meshing {

using Eigen::Matrix3Xd;

double largest_eigenvalue(const std::function<Matrix3Xd(const Matrix3Xd& q)>& product, const Matrix3Xd& start,
                          const std::function<double(const Matrix3Xd& a, const Matrix3Xd& b)>& dot) {
  const auto product_of = [&](const Matrix3Xd& a, const Matrix3Xd& b) {
    return dot ? dot(a, b) : a.cwiseProduct(b).sum();
  };
  const auto norm_of = [&](const Matrix3Xd& a) { return std::sqrt(product_of(a, a)); };
  constexpr int kMaxIterations = 60;
  constexpr double kTolerance = 1e-3;
  Matrix3Xd q = start / norm_of(start), q_before = Matrix3Xd::Zero(3, start.cols());
  std::vector<double> alpha, beta;
  double largest = 0;
  for (int j = 0; j < kMaxIterations; ++j) {
    Matrix3Xd r = product(q) - (j > 0 ? beta.back() : 0.) * q_before;
    alpha.push_back(product_of(r, q));
    r -= alpha.back() * q;
    beta.push_back(norm_of(r));
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
