#include "fem_reference/solvers/distributed.h"

#include <Epetra_FECrsMatrix.h>
#include <Epetra_MpiComm.h>
#include <Epetra_Vector.h>
#include <ml_MultiLevelPreconditioner.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "fem_reference/base/processes.h"
#include "fem_reference/solvers/amg.h"
#include "meshing/algebra/rigid_motion.h"

namespace testbed::fem {
namespace {

constexpr int kMaxIterations = 2000;
constexpr double kShift = 1e-8;  // of the diagonal, where rigid motions are free

/// Nodes that this process owns: of its cells, those that no process before it has.
std::vector<int> owned_nodes(const Nodes& nodes, const Space& space) {
  std::vector<unsigned> owner(nodes.X.cols(), std::numeric_limits<unsigned>::max());
  for (const auto& cell : space.dofs.active_cell_iterators())
    for (const int node : nodes.cells.col(static_cast<int>(cell->active_cell_index())))
      owner[node] = std::min(owner[node], cell->subdomain_id());
  std::vector<int> owned;
  for (int node = 0; node < nodes.X.cols(); ++node)
    if (owner[node] == static_cast<unsigned>(processes().rank)) owned.push_back(node);
  return owned;
}

/// This process' part of a vector, for conjugate gradients.
struct Part {
  using Scalar = double;
  Eigen::VectorXd values;
};
double dot(const Part& u, const Part& w) {
  double product = u.values.dot(w.values);
  sum_over_processes(Eigen::Map<Eigen::VectorXd>(&product, 1));
  return product;
}
double advance(double alpha, const Part& p, const Part& Ap, Part& x, Part& r) {
  x.values += alpha * p.values;
  r.values -= alpha * Ap.values;
  return dot(r, r);
}
void aypx(double beta, const Part& z, Part& p) {
  p.values = z.values + beta * p.values;
}

/// Takes the components along orthonormal columns out of u.
void remove(const Eigen::MatrixXd& columns, Eigen::VectorXd& u) {
  if (columns.cols() == 0) return;
  Eigen::VectorXd components = columns.transpose() * u;
  sum_over_processes(components);
  u -= columns * components;
}

}  // namespace

LinearReport solve_distributed(const Nodes& nodes, const Space& space, const meshing::BlockMatrix& part,
                               const std::vector<int>& rank, const Eigen::MatrixXd& rigid,
                               const Eigen::Matrix3Xd& b, double tolerance, Eigen::Matrix3Xd& x) {
  const std::vector<int> owned = owned_nodes(nodes, space);
  std::vector<int> unknowns, by_node;  // 3 rank + component and 3 node + component of those that are owned
  for (const int node : owned)
    for (int c = 0; c < 3; ++c) {
      unknowns.push_back(3 * rank[node] + c);
      by_node.push_back(3 * node + c);
    }
  const auto n_owned = static_cast<int>(unknowns.size());
  const Epetra_Map map(-1, n_owned, unknowns.data(), 0, Epetra_MpiComm(MPI_COMM_WORLD));
  Epetra_FECrsMatrix A(Copy, map, 0);
  for (int i = 0; i < part.rows(); ++i)
    for (int k = part.row_start[i]; k < part.row_start[i + 1]; ++k) {
      if (part.block[k].isZero(0)) continue;
      const int rows[] = {3 * i, 3 * i + 1, 3 * i + 2}, column = 3 * part.column[k],
                columns[] = {column, column + 1, column + 2};
      A.InsertGlobalValues(3, rows, 3, columns, part.block[k].data(), Epetra_FECrsMatrix::COLUMN_MAJOR);
    }
  A.GlobalAssemble();
  A.OptimizeStorage();

  Eigen::MatrixXd motions = rigid_motions(nodes.X)(by_node, Eigen::all);
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
  const Eigen::MatrixXd free = rigid(by_node, Eigen::all);
  Part r{b.reshaped()(by_node)}, solution{Eigen::VectorXd::Zero(n_owned)};
  remove(free, r.values);
  LinearReport report;
  static_cast<meshing::SolveReport&>(report) = meshing::conjugate_gradients(
      [&](const Part& p, Part& Ap) {
        Ap.values.resize(n_owned);
        Epetra_Vector out = seen(Ap.values);
        A.Multiply(false, seen(p.values), out);
        remove(free, Ap.values);
      },
      [&](const Part& q, Part& z) {
        z.values.resize(n_owned);
        Epetra_Vector out = seen(z.values);
        multigrid->ApplyInverse(seen(q.values), out);
        remove(free, z.values);
      },
      r, std::sqrt(dot(r, r)), solution, tolerance, kMaxIterations);
  report.is_definite = report.curvature >= 0;
  report.solver = "CG, algebraic multigrid, " + std::to_string(processes().n) + " processes";
  Eigen::VectorXd whole = Eigen::VectorXd::Zero(b.size());
  whole(by_node) = solution.values;
  sum_over_processes(whole);
  x.reshaped() += whole;
  return report;
}

}  // namespace testbed::fem
