// Sweeps of Gauss-Seidel over a matrix of 3 x 3 blocks, in single precision.
#pragma once

#include <vector>

#include "meshing/algebra/block_matrix.h"

namespace testbed::meshing {

/// Smooths by A = L + D + L^T, D its diagonal blocks. Rows are in subdomains [subdomains.h] whose rows of one
/// size have no entries in common, so that threads share them and change nothing.
class GaussSeidel {
 public:
  /// Both must outlive it.
  /// @param blocks     of the pattern, and three numbers at the end
  /// @param first_row  of each subdomain, and the number of rows that are swept
  /// @param added      to the diagonal in sweeps; empty: nothing
  GaussSeidel(const BlockMatrix& pattern, const std::vector<float>& blocks, std::vector<int> first_row,
              const PaddedField& added = {});

  /// z = (D + L)^-1 r.
  void sweep_down(const PaddedField& r, PaddedField& z) const;
  /// d = r - A z of that z, where nothing is added.
  void residual_of_sweep(const PaddedField& z, PaddedField& d) const;
  /// z += (D + L^T)^-1 (r - A z).
  void sweep_up(const PaddedField& r, PaddedField& z) const;

 private:
  template <class Visit>
  void for_each_part(bool is_backwards, const Visit& visit) const;

  const BlockMatrix& pattern_;
  const std::vector<float>& blocks_;
  std::vector<int> first_row_;
  std::vector<float> inverse_;  ///< of the diagonal blocks
};

}  // namespace testbed::meshing
