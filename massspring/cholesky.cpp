#include "massspring/cholesky.h"

#include <Eigen/CholmodSupport>
#include <Eigen/SparseCore>

namespace testbed {

struct BlockCholesky::Factor {
  Eigen::CholmodSupernodalLLT<Eigen::SparseMatrix<double>> llt;
};

BlockCholesky::BlockCholesky(const BlockMatrix& A) : factor_(std::make_unique<Factor>()) {
  Eigen::SparseMatrix<double> lower(3 * A.rows(), 3 * A.rows());
  std::vector<int> n_per_column(3 * A.rows());
  for (int i = 0; i < A.rows(); ++i)
    for (int c = 0; c < 3; ++c) n_per_column[3 * i + c] = 3 * (A.row_start[i + 1] - A.find(i, i)) - c;
  lower.reserve(n_per_column);
  // Column 3 i + c of the lower triangle is row 3 i + c of the upper one: blocks j >= i of block row i.
  for (int i = 0; i < A.rows(); ++i)
    for (int c = 0; c < 3; ++c)
      for (int k = A.find(i, i); k < A.row_start[i + 1]; ++k)
        for (int r = A.column[k] == i ? c : 0; r < 3; ++r)
          lower.insert(3 * A.column[k] + r, 3 * i + c) = A.block[k](c, r);
  lower.makeCompressed();
  factor_->llt.cholmod().print = 0;
  factor_->llt.compute(lower);
}

BlockCholesky::~BlockCholesky() = default;

bool BlockCholesky::is_ok() const {
  return factor_->llt.info() == Eigen::Success;
}

void BlockCholesky::solve(const Eigen::Matrix3Xd& b, Eigen::Matrix3Xd& x) const {
  const Eigen::VectorXd solution = factor_->llt.solve(Eigen::Map<const Eigen::VectorXd>(b.data(), b.size()));
  x = Eigen::Map<const Eigen::Matrix3Xd>(solution.data(), 3, b.cols());
}

}  // namespace testbed
