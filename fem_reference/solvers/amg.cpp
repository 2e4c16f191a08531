#include "fem_reference/solvers/amg.h"

#include <Epetra_CrsMatrix.h>
#include <Epetra_Map.h>
#include <Epetra_MpiComm.h>
#include <Epetra_Vector.h>
#include <ml_MultiLevelPreconditioner.h>

#include <stdexcept>

#include "fem_reference/base/processes.h"

namespace testbed::fem {
namespace {

/// ML speaks MPI even to itself.
Epetra_MpiComm alone() {
  start_mpi();
  return Epetra_MpiComm(MPI_COMM_SELF);
}

Epetra_CrsMatrix copy_of(const Eigen::SparseMatrix<double, Eigen::RowMajor>& lower, const Epetra_Map& map) {
  const Eigen::SparseMatrix<double, Eigen::RowMajor> A = lower.selfadjointView<Eigen::Lower>();
  Eigen::VectorXi n_entries(A.rows());
  for (int i = 0; i < A.rows(); ++i) n_entries(i) = A.outerIndexPtr()[i + 1] - A.outerIndexPtr()[i];
  Epetra_CrsMatrix copy(Copy, map, map, n_entries.data(), true);
  for (int i = 0; i < A.rows(); ++i) {
    const int start = A.outerIndexPtr()[i];
    copy.InsertGlobalValues(i, n_entries(i), A.valuePtr() + start, A.innerIndexPtr() + start);
  }
  copy.FillComplete();
  copy.OptimizeStorage();
  return copy;
}

}  // namespace

std::shared_ptr<ML_Epetra::MultiLevelPreconditioner> make_multigrid(const Epetra_RowMatrix& matrix,
                                                                    Eigen::MatrixXd& near_null) {
  Teuchos::ParameterList options;
  ML_Epetra::SetDefaults("SA", options);
  options.set("ML output", 0);
  options.set("PDE equations", 3);
  options.set("aggregation: type", "Uncoupled");
  options.set("smoother: type", "Chebyshev");  // 1.5 times as fast as symmetric Gauss-Seidel
  options.set("smoother: sweeps", 2);
  options.set("coarse: type", "Amesos-KLU");
  options.set("coarse: max size", 2000);  // iterations grow with levels
  options.set("null space: type", "pre-computed");
  options.set("null space: dimension", static_cast<int>(near_null.cols()));
  options.set("null space: vectors", near_null.data());
  auto cycle = std::make_shared<ML_Epetra::MultiLevelPreconditioner>(matrix, options, true);
  if (!cycle->IsPreconditionerComputed())
    throw std::runtime_error("algebraic multigrid: ML finds no hierarchy for this matrix");
  return cycle;
}

struct AlgebraicMultigrid::Hierarchy {
  Eigen::MatrixXd near_null;
  Epetra_Map map;
  Epetra_CrsMatrix matrix;
  std::shared_ptr<ML_Epetra::MultiLevelPreconditioner> cycle;

  Hierarchy(const Eigen::SparseMatrix<double, Eigen::RowMajor>& lower, Eigen::MatrixXd motions)
      : near_null(std::move(motions)),
        map(static_cast<int>(lower.rows()), 0, alone()),
        matrix(copy_of(lower, map)),
        cycle(make_multigrid(matrix, near_null)) {}
};

AlgebraicMultigrid::AlgebraicMultigrid(const Eigen::SparseMatrix<double, Eigen::RowMajor>& lower,
                                       Eigen::MatrixXd near_null)
    : hierarchy_(std::make_unique<Hierarchy>(lower, std::move(near_null))) {}
AlgebraicMultigrid::~AlgebraicMultigrid() = default;

Eigen::VectorXd AlgebraicMultigrid::apply(const Eigen::VectorXd& r) const {
  Eigen::VectorXd z(r.size());
  const Epetra_Vector in(View, hierarchy_->map, const_cast<double*>(r.data()));
  Epetra_Vector out(View, hierarchy_->map, z.data());
  hierarchy_->cycle->ApplyInverse(in, out);
  return z;
}

}  // namespace testbed::fem
