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

Epetra_CrsMatrix copy_of(const meshing::BlockMatrix& A, const Epetra_Map& map) {
  std::vector<int> n_entries, columns;
  std::vector<double> values;
  for (int i = 0; i < A.rows(); ++i)
    n_entries.insert(n_entries.end(), 3, 3 * (A.row_start[i + 1] - A.row_start[i]));
  Epetra_CrsMatrix copy(Copy, map, map, n_entries.data(), true);
  for (int i = 0; i < A.rows(); ++i)
    for (int c = 0; c < 3; ++c) {
      columns.clear();
      values.clear();
      for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k)
        for (int d = 0; d < 3; ++d) {
          columns.push_back(3 * A.column[k] + d);
          values.push_back(A.block[k](c, d));
        }
      copy.InsertGlobalValues(3 * i + c, static_cast<int>(values.size()), values.data(), columns.data());
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

  Hierarchy(const meshing::BlockMatrix& A, Eigen::MatrixXd motions)
      : near_null(std::move(motions)),
        map(3 * A.rows(), 0, alone()),
        matrix(copy_of(A, map)),
        cycle(make_multigrid(matrix, near_null)) {}
};

AlgebraicMultigrid::AlgebraicMultigrid(const meshing::BlockMatrix& A, Eigen::MatrixXd near_null)
    : hierarchy_(std::make_unique<Hierarchy>(A, std::move(near_null))) {}
AlgebraicMultigrid::~AlgebraicMultigrid() = default;

Eigen::VectorXd AlgebraicMultigrid::apply(const Eigen::VectorXd& r) const {
  Eigen::VectorXd z(r.size());
  const Epetra_Vector in(View, hierarchy_->map, const_cast<double*>(r.data()));
  Epetra_Vector out(View, hierarchy_->map, z.data());
  hierarchy_->cycle->ApplyInverse(in, out);
  return z;
}

}  // namespace testbed::fem
