#include "fem_reference/solvers/distributed.h"

#include <Epetra_FECrsMatrix.h>
#include <Epetra_MpiComm.h>
#include <Epetra_Vector.h>
#include <ml_MultiLevelPreconditioner.h>

#include <algorithm>
#include <limits>

#include "fem_reference/base/processes.h"
#include "fem_reference/base/rigid.h"
#include "fem_reference/solvers/amg.h"
#include "fem_reference/solvers/conjugate_gradients.h"

namespace testbed::fem {
namespace {

constexpr int kMaxIterations = 2000;
constexpr double kShift = 1e-8;  // of the diagonal, where rigid motions are free

/// Unknowns of the nodes that this process owns: of its cells, those that no process before it has.
std::vector<int> owned_unknowns(const Space& space) {
  std::vector<unsigned> owner(space.dofs.n_dofs() / 3, std::numeric_limits<unsigned>::max());
  for (const auto& cell : space.dofs.active_cell_iterators())
    for (int rank : space.ranks(cell)) owner[rank] = std::min(owner[rank], cell->subdomain_id());
  std::vector<int> owned;
  for (int i = 0; i < static_cast<int>(space.dofs.n_dofs()); ++i)
    if (owner[i / 3] == static_cast<unsigned>(processes().rank)) owned.push_back(i);
  return owned;
}

}  // namespace

LinearReport solve_distributed(const Nodes& nodes, const Space& space, const SystemMatrix& part,
                               const Eigen::MatrixXd& rigid, const Eigen::VectorXd& b, double tolerance) {
  const std::vector<int> owned = owned_unknowns(space);
  const auto n_owned = static_cast<int>(owned.size());
  const Epetra_Map map(-1, n_owned, owned.data(), 0, Epetra_MpiComm(MPI_COMM_WORLD));
  Epetra_FECrsMatrix A(Copy, map, 0);
  {
    SystemMatrix::Rows rows = part.lower.selfadjointView<Eigen::Lower>();
    for (int i = 0; i < rows.rows(); ++i) {
      const int start = rows.outerIndexPtr()[i], n = rows.outerIndexPtr()[i + 1] - start;
      if (n > 0)
        A.InsertGlobalValues(1, &i, n, rows.innerIndexPtr() + start, rows.valuePtr() + start,
                             Epetra_FECrsMatrix::ROW_MAJOR);
    }
  }
  A.GlobalAssemble();
  A.OptimizeStorage();

  const Eigen::MatrixXd by_node = rigid_motions(nodes.X);
  Eigen::MatrixXd motions(n_owned, 6);
  for (int k = 0; k < n_owned; ++k) motions.row(k) = by_node.row(space.flat_of[owned[k]]);
  Epetra_CrsMatrix definite(A);
  if (rigid.cols() > 0) {
    Epetra_Vector diagonal(map);
    definite.ExtractDiagonalCopy(diagonal);
    diagonal.Scale(1 + kShift);
    definite.ReplaceDiagonalValues(diagonal);
  }
  const auto multigrid = make_multigrid(definite, motions);

  const auto seen = [&](const Eigen::VectorXd& v) {
    return Epetra_Vector(View, map, const_cast<double*>(v.data()));
  };
  LinearReport report = conjugate_gradients(
      [&](const Eigen::VectorXd& p, Eigen::VectorXd& Kp) {
        Epetra_Vector out = seen(Kp);
        A.Multiply(false, seen(p), out);
      },
      [&](const Eigen::VectorXd& r) {
        Eigen::VectorXd z(r.size());
        Epetra_Vector out = seen(z);
        multigrid->ApplyInverse(seen(r), out);
        return z;
      },
      A.NormFrobenius(), rigid(owned, Eigen::all), b(owned), tolerance, kMaxIterations);
  report.solver = "CG, algebraic multigrid, " + std::to_string(processes().n) + " processes";
  Eigen::VectorXd x = Eigen::VectorXd::Zero(b.size());
  x(owned) = report.x;
  sum_over_processes(x);
  report.x = x;
  return report;
}

}  // namespace testbed::fem
