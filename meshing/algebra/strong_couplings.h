// Nodes that flat tetrahedra couple, which sweeps over single nodes hardly move.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "meshing/algebra/block_matrix.h"
#include "meshing/algebra/single_precision_factor.h"
#include "meshing/base/archive.h"

namespace testbed::meshing {

/// The nodes of a stiffness that are coupled to another far more strongly than others at such a distance, and a
/// Cholesky factor of their part of it. Around a preconditioner B, correcting them by that factor, S, before and after, it is
/// a multiplicative Schwarz method of two subspaces: (1 - S A)(1 - B A)(1 - S A) of an error is left [Xu 1992].
class StrongCouplings {
 public:
  StrongCouplings() = default;  ///< of no node
  /// @param blocks  of the pattern, 9 numbers each by columns (N/m)
  /// @param X       3 x n nodes (m)
  StrongCouplings(const BlockMatrix& pattern, const std::vector<float>& blocks, const Eigen::Matrix3Xd& X);
  friend void archive(Archive& a, StrongCouplings& s) {
    a(s.nodes_, s.row_start_, s.column_, s.block_, s.factor_);
  }

  int n_nodes() const { return static_cast<int>(nodes_.size()); }

  /// z = a symmetric positive definite approximation of A^-1 r, as precondition(r, z) is one; that alone where nothing is
  /// coupled strongly.
  template <class Precondition>
  void around(const Precondition& precondition, const PaddedField& r, PaddedField& z) const {
    if (nodes_.empty()) return precondition(r, z);
    PaddedField corrected, rest;
    begin(r, corrected, rest);
    precondition(rest, z);
    z += corrected;
    end(r, z);
  }

 private:
  /// z = A_s^-1 r, A_s their part of A; rest = r - A z.
  void begin(const PaddedField& r, PaddedField& z, PaddedField& rest) const;
  /// z += A_s^-1 (r - A z).
  void end(const PaddedField& r, PaddedField& z) const;

  std::vector<int> nodes_;
  std::vector<int> row_start_, column_;  // their rows of A
  std::vector<float> block_;             // 9 numbers each, by columns
  SinglePrecisionFactor factor_;
};

}  // namespace testbed::meshing
