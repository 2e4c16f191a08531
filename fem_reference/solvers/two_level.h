// Conjugate gradients for the stiffness of a body, in single precision.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "fem_reference/elements/share.h"
#include "fem_reference/elements/tet_batches.h"
#include "meshing/algebra/cholesky.h"
#include "meshing/algebra/conjugate_gradients.h"
#include "meshing/algebra/gauss_seidel.h"
#include "meshing/algebra/multigrid.h"
#include "meshing/algebra/strong_couplings.h"

namespace testbed::fem {

struct LinearReport : meshing::SolveReport {
  std::string solver;
  bool is_definite = true;  ///< false where a factor does not exist or a direction of no stiffness was met
};

/// A field for conjugate gradients whose sums go over all processes; it is zero where others own.
template <class Field>
struct Summed : Field {
  using Field::Field;
  using Field::operator=;
  const Field& field() const { return *this; }
  Field& field() { return *this; }
};
template <class Field>
double dot(const Summed<Field>& u, const Summed<Field>& w) {
  return sum_over_processes(meshing::dot(u.field(), w.field()));
}
template <class Field>
double advance(typename Field::Scalar alpha, const Summed<Field>& p, const Summed<Field>& Ap,
               Summed<Field>& x, Summed<Field>& r) {
  return sum_over_processes(
      static_cast<double>(meshing::advance(alpha, p.field(), Ap.field(), x.field(), r.field())));
}
template <class Field>
void aypx(typename Field::Scalar beta, const Summed<Field>& z, Summed<Field>& p) {
  meshing::aypx(beta, z.field(), p.field());
}

/// Conjugate gradients. On degree 1 their preconditioner is a Cholesky factor or, for large systems, multigrid with rigid
/// motions as near-null space. On degree 2 it has two levels: Gauss-Seidel sweeps and a correction of the corners, by one
/// of the former; long bodies, whose factor has few entries, take that. Nodes of flat tetrahedra are corrected together.
/// Where iterations stand still, a Cholesky factor of the whole matrix follows, if memory allows. Several processes sweep
/// over their rows at once, each with what the others had before [Baker, Falgout, Kolev & Yang 2011], and take Trilinos'
/// multigrid for degree 1. Factors are kept from one solve to the next while they serve. Entries outside the pattern are
/// in products and factors, and not in sweeps; multigrid has a larger diagonal instead.
class TwoLevelSolver {
 public:
  /// Entries of a stiffness that its pattern has no place for, over ranks of nodes.
  struct Outside {
    std::vector<meshing::SymmetricBlock> blocks;
    std::vector<meshing::PaddedField> roots;  ///< each adds g g^T
  };
  /// Fills a matrix in double precision, to be factorised, and returns the blocks outside its pattern.
  using Fill = std::function<std::vector<meshing::SymmetricBlock>(meshing::BlockMatrix& A)>;
  /// A stiffness, and how to make it in double precision. Constrained unknowns are filled in.
  struct Stiffness {
    std::vector<float> blocks;  ///< of the fine pattern, and three numbers at the end
    Fill fill_fine, fill_corners;
    Outside outside;
    mutable std::optional<meshing::StrongCouplings> strong = {};  ///< of one process, made by the first solve
  };

  /// @param X        3 x n nodes, the corners of tetrahedra first (m)
  /// @param edges    whose middles are the nodes behind the corners
  /// @param fine, corners  the body's tetrahedra, and those of degree 1 on the same corners, null on degree 1
  TwoLevelSolver(const Share& share, const Eigen::Matrix3Xd& X, const Eigen::Matrix2Xi& edges,
                 const TetBatches& fine, const TetBatches* corners);

  /// Takes over what is constrained (3 node + component), and drops what was made of other matrices.
  void hold(const std::vector<char>& is_constrained);

  /// Adds to x the solution of A x = r, both 3 x n over nodes; those of `rigid` (3 node + component,
  /// orthonormal) are kept out of it. Where iterations stand still, turns to a factor of the whole matrix or, if
  /// that is left to the caller, returns.
  LinearReport solve(const Stiffness& A, const Eigen::MatrixXd& rigid, const Eigen::Matrix3Xd& r,
                     double tolerance, Eigen::Matrix3Xd& x, bool may_turn = true);
  /// y += factor A x, fields over nodes.
  void add_product(const Stiffness& A, double factor, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& y) const;
  /// Makes a Cholesky factor of the whole matrix for what follows, if memory allows.
  void turn_to_factor(const Stiffness& A, bool is_singular);
  /// z = the last preconditioner times r, fields over nodes, as long as this and A live; a factor of the whole matrix is in
  /// double precision.
  std::function<void(const Eigen::Matrix3Xd& r, Eigen::Matrix3Xd& z)> preconditioner(
      const Stiffness& A, const Eigen::MatrixXd& rigid) const;
  bool has_whole_factor() const { return is_whole_; }
  std::string name() const;

 private:
  using PaddedField = meshing::PaddedField;
  struct Pass;

  bool factorise(const Stiffness& A, bool is_singular);
  bool factorise_whole(const Stiffness& A, bool is_singular);
  meshing::SinglePreconditioner multigrid_of(const meshing::BlockMatrix& A, const TetBatches& tets) const;
  void correct_corners(const PaddedField& d, PaddedField& z) const;
  void solve_degree_1(const PaddedField& r, PaddedField& z) const;
  void multiply(const Stiffness& A, const PaddedField& p, PaddedField& y) const;
  void clear_ghosts(PaddedField& u) const;
  void pad(const Eigen::Matrix3Xd& u, double factor, PaddedField& result) const;
  void add_unpadded(const PaddedField& w, double factor, Eigen::Matrix3Xd& u) const;
  bool may_factorise() const;

  const Share& share_;
  const Eigen::Matrix3Xd& X_;
  const TetBatches &fine_, *corners_;
  Eigen::Matrix3Xd by_rank_;              // nodes, on degree 2
  Exchange exchange_, exchange_corners_;  // over ranks
  Eigen::Matrix2Xi ends_;                 // ranks among the corners of each row's edge, or twice its corner's
  PaddedField free_, free_corners_;       // 1, and 0 where constrained
  std::optional<meshing::BlockCholesky> cholesky_;
  std::optional<meshing::SinglePrecisionFactor> factor_;  // of cholesky_: of degree 1, or of the whole matrix
  meshing::SinglePreconditioner multigrid_;               // of degree 1, in place of factor_
  bool is_ready_ = false, is_whole_ = false;
  int n_iterations_ = 0;  // of the first solve with the present factor
};

}  // namespace testbed::fem
