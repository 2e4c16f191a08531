// The matrix of an implicit step, of which no more is formed than is used.
#pragma once

#include "massspring/kernels/spring_rows.h"
#include "massspring/time/equation_of_motion.h"
#include "meshing/algebra/linear_solver.h"

namespace testbed::massspring {

/// Which of the forces that the paper calls gradients are kept in the matrix: its bi-conjugate gradients need
/// none, its conjugate gradients go without [paper 3.4].
struct Gradients {
  bool volume = true;   ///< of the global volume force and of tetrahedra
  bool bending = true;  ///< of the skin
};

/// A = mass M + stiffness K + damping D on the free directions: M the masses, K the Hessian of the potential,
/// D the damping matrix of the springs. Where springs are all there is, or coupled springs of a linear model,
/// A is applied spring by spring, or patch by patch, and only a factorisation forms it.
class ImplicitMatrix {
 public:
  struct Factors {
    double mass, stiffness, damping;
    bool operator==(const Factors& other) const {
      return mass == other.mass && stiffness == other.stiffness && damping == other.damping;
    }
  };

  explicit ImplicitMatrix(const EquationOfMotion& motion, const Gradients& gradients = {});

  /// @param at         K is taken at its positions and rest lengths
  /// @param damped_at  positions (3 x n) that give the springs' directions in D
  void set(const State& at, const Eigen::Matrix3Xd& damped_at, const Factors& factors, Curvature curvature);

  /// y = A p, 3 x n; of p also the constrained directions count.
  void multiply(const Eigen::Matrix3Xd& p, Eigen::Matrix3Xd& y) const;

  /// For LinearSolver; valid until the next set.
  LinearSystem system();

  /// A on the constrained space [filter], of the surface the diagonal alone.
  const BlockMatrix& matrix();

 private:
  void assemble(const State& at, Curvature curvature, BlockMatrix& A) const;
  void complete(BlockMatrix& A) const;
  const BlockMatrix& preconditioning_matrix();
  void make_single();
  void filter_single(PaddedField& y) const;
  double multiply_single(const PaddedField& p, PaddedField& y);
  void diagonal(std::vector<Eigen::Matrix3d>& blocks) const;

  const EquationOfMotion& motion_;
  bool has_volume_;
  std::unique_ptr<MassSpringModel> reduced_;  ///< without the parts whose gradients are dropped
  const MassSpringModel& model_;              ///< what the matrix knows of
  bool is_linear_;                            ///< applied patch by patch
  Factors factors_{};
  Eigen::VectorXd mass_;  ///< at nodes, times its factor
  std::optional<SpringBlocks> springs_, damping_;
  std::optional<BlockMatrix> K_;  ///< all of A but the surface and constraints, where not springs alone
  SurfaceHessian surface_;        ///< of what acts on the surface, times its factor
  Eigen::Matrix3Xd x_;            ///< positions that it is taken at
  std::optional<BlockMatrix> A_;

  /// In single precision, where that is asked for.
  struct SinglePrecision {
    Eigen::VectorXf mass;
    Eigen::Matrix4Xf springs, damping;  ///< in rows
    std::vector<float> K;
    std::vector<PaddedField> roots;  ///< of the surface
  };
  std::optional<SpringRows> rows_;
  std::optional<SingleStiffness> stiffness_;  ///< of a linear model, without its factor
  std::optional<SinglePrecision> single_;
};

}  // namespace testbed::massspring
