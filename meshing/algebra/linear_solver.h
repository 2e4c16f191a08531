// The linear systems of implicit steps.
#pragma once

#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "meshing/algebra/cholesky.h"
#include "meshing/algebra/conjugate_gradients.h"
#include "meshing/algebra/linear_system.h"
#include "meshing/algebra/multigrid.h"
#include "meshing/base/choices.h"

namespace testbed::meshing {

/// Conjugate gradients, preconditioned by the inverse diagonal blocks until these have cost more than they
/// should, then by multigrid or, on few nodes, a Cholesky factor. Both are kept from system to system while
/// they serve. Where multigrid stands still a factor takes its place if its fill is affordable. Costs are
/// counts of iterations, so that a run repeats itself. From 500 nodes on in single precision, refined by
/// residuals in double, unless that has once been too little [Wilkinson 1963]. Or, to compare, bi-conjugate
/// gradients, stabilised or not, with the inverse diagonal blocks.
class LinearSolver {
 public:
  explicit LinearSolver(Krylov krylov = Krylov::Cg) : krylov_(krylov) {}

  /// One for stiffness matrices alone, which need multigrid or a factor from the first system on.
  /// @param is_floppy  motions may cost no energy: a factor in double precision
  static LinearSolver of_stiffness(bool is_floppy);
  /// One by a factor in double precision from the first system on; why: of the choice.
  static LinearSolver of_factor(const std::string& why);
  /// One for a stiffness matrix whose nodes halve the edges of another one's, as TwoGrid; nothing else is tried.
  static LinearSolver of_halved_edges(const Eigen::Matrix2Xi& between, SinglePreconditioner coarser);

  /// @param x  the first guess, then the solution
  SolveReport solve(const LinearSystem& A, const Eigen::Matrix3Xd& b, Eigen::Matrix3Xd& x, double tolerance);

  /// That of the last system, in single precision, as long as this lives; empty where there is none but block Jacobi.
  SinglePreconditioner preconditioner();

  /// All that it keeps from system to system but a preconditioner of halved edges.
  friend void archive(Archive& a, LinearSolver& solver);

  /// The preconditioner in use and why.
  const std::string& choice() const { return choice_; }

 private:
  using Matrix3Xd = Eigen::Matrix3Xd;

  /// Preconditioner of the system at hand, in either precision.
  struct BlockJacobi {
    std::vector<Eigen::Matrix3d> inverse;  ///< of the diagonal blocks
    SymmetricBlocks single;

    void operator()(const Matrix3Xd& r, Matrix3Xd& z) const;
    double operator()(const PaddedField& r, PaddedField& z) const { return multiply(single, r, z); }
  };
  /// How a preconditioner of an earlier system served.
  struct Service {
    double first_rate = 0;  ///< iterations a digit when it was new
    double excess = 0;      ///< iterations since that a new one would have spared
  };
  struct Factor {
    std::unique_ptr<BlockCholesky> cholesky;  ///< of an earlier system; empty: to be made anew
    SinglePrecisionFactor single;
    Service service;
  };
  struct RigidGroups {
    std::unique_ptr<Multigrid> multigrid;  ///< of an earlier system; empty: to be made anew
    Service service;
  };

  struct HalvedEdges {
    Eigen::Matrix2Xi between;
    SinglePreconditioner coarser;
    std::unique_ptr<TwoGrid> two_grid;  ///< empty: to be made
  };

  // Each solves a system and decides what preconditions the next one; they add up iterations in n.
  SolveReport solve_with(BlockJacobi& jacobi, const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x,
                         double tolerance, int& n);
  SolveReport solve_with(Factor& factor, const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x,
                         double tolerance, int& n);
  SolveReport solve_with(RigidGroups& groups, const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x,
                         double tolerance, int& n);
  SolveReport solve_with(HalvedEdges& halved, const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x,
                         double tolerance, int& n);
  void wear_out(RigidGroups& groups);
  SolveReport solve_on(const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x, double tolerance, int& n);
  template <class Precondition>
  SolveReport refine(const LinearSystem& A, const Precondition& precondition, const Matrix3Xd& b,
                     Matrix3Xd& x, double tolerance, int max_iterations);
  template <class Precondition>
  SolveReport iterate(const LinearSystem& A, const Precondition& precondition, const Matrix3Xd& b,
                      Matrix3Xd& x, double tolerance, int max_iterations, int& n);

  Krylov krylov_;
  std::variant<BlockJacobi, Factor, RigidGroups, HalvedEdges> preconditioner_;
  bool is_hard_ = false;          ///< block Jacobi is not tried
  bool is_floppy_ = false;        ///< multigrid is not tried
  double waste_ = 0;              ///< iterations with block Jacobi that multigrid would have spared
  int patience_ = 500;            ///< what it may waste before another is tried
  bool is_single_enough_ = true;  ///< single precision led to the tolerance so far
  std::string choice_ = "block Jacobi: no system was hard so far";
};

}  // namespace testbed::meshing
