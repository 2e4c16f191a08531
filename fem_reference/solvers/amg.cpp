#include "fem_reference/solvers/amg.h"

#include <Epetra_CrsMatrix.h>
#include <Epetra_Map.h>
#include <Epetra_MpiComm.h>
#include <Epetra_Vector.h>
#include <ml_MultiLevelPreconditioner.h>

#include <stdexcept>

namespace testbed::fem {
namespace {

/// Three unknowns of each of the first n numbers.
Epetra_Map map_of(int n, const std::vector<int>& number) {
  std::vector<int> unknowns;
  for (int i = 0; i < n; ++i)
    for (int c = 0; c < 3; ++c) unknowns.push_back(3 * number[i] + c);
  return Epetra_Map(-1, 3 * n, unknowns.data(), 0, Epetra_MpiComm(MPI_COMM_WORLD));
}

Epetra_CrsMatrix copy_of(const meshing::BlockMatrix& A, const Epetra_Map& map,
                         const std::vector<int>& number) {
  const int n = map.NumMyElements() / 3;
  std::vector<int> n_entries, columns;
  std::vector<double> values;
  for (int i = 0; i < n; ++i) n_entries.insert(n_entries.end(), 3, 3 * (A.row_start[i + 1] - A.row_start[i]));
  Epetra_CrsMatrix copy(Copy, map, n_entries.data(), true);
  for (int i = 0; i < n; ++i)
    for (int c = 0; c < 3; ++c) {
      columns.clear();
      values.clear();
      for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k)
        for (int d = 0; d < 3; ++d) {
          columns.push_back(3 * number[A.column[k]] + d);
          values.push_back(A.block[k](c, d));
        }
      copy.InsertGlobalValues(3 * number[i] + c, static_cast<int>(values.size()), values.data(),
                              columns.data());
    }
  copy.FillComplete();
  copy.OptimizeStorage();
  return copy;
}

/// Both arguments must outlive it.
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

}  // namespace

struct AlgebraicMultigrid::Hierarchy {
  Eigen::MatrixXd near_null;
  Epetra_Map map;
  Epetra_CrsMatrix matrix;
  std::shared_ptr<ML_Epetra::MultiLevelPreconditioner> cycle;

  Hierarchy(const meshing::BlockMatrix& A, Eigen::MatrixXd motions, const std::vector<int>& number)
      : near_null(std::move(motions)),
        map(map_of(static_cast<int>(near_null.rows() / 3), number)),
        matrix(copy_of(A, map, number)),
        cycle(make_multigrid(matrix, near_null)) {}
};

AlgebraicMultigrid::AlgebraicMultigrid(const meshing::BlockMatrix& A, Eigen::MatrixXd near_null,
                                       const std::vector<int>& number)
    : hierarchy_(std::make_unique<Hierarchy>(A, std::move(near_null), number)) {}
AlgebraicMultigrid::~AlgebraicMultigrid() = default;

Eigen::VectorXd AlgebraicMultigrid::apply(const Eigen::VectorXd& r) const {
  Eigen::VectorXd z(r.size());
  const Epetra_Vector in(View, hierarchy_->map, const_cast<double*>(r.data()));
  Epetra_Vector out(View, hierarchy_->map, z.data());
  hierarchy_->cycle->ApplyInverse(in, out);
  return z;
}

}  // namespace testbed::fem
