// The sums of coupled springs, for registers: batches of patches side by side, nodes padded to four doubles.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "meshing/algebra/vectors.h"

namespace testbed::massspring {

/// Patches in a batch.
inline constexpr int kBatchSize = 8;

/// Nodes and vectors of patches in batches. A patch with fewer nodes than another of its batch has its first
/// one again, with zero vectors; so has one that the last batch of a subdomain lacks.
struct PatchBatches {
  std::vector<int> first;  ///< the first patch of each batch, and the end
  std::vector<int> start;  ///< of each batch's entries, and the end
  std::vector<int> node;   ///< kBatchSize of each entry
  std::vector<double> b;   ///< 3 kBatchSize of each entry: all x, all y, all z (1/m)

  int n_batches() const { return static_cast<int>(first.size()) - 1; }
};

/// Constants of each patch.
struct PatchArrays {
  const double* volume;  ///< m3
  const double* lambda;  ///< Pa
  const double* scale;   ///< of the rest shape; null: ones
  double mu;             ///< Pa
};

/// det F and |F|^2 of the patches of batches begin to end - 1, from the first place on.
/// @param x  a column for each node
void measure_patches(int begin, int end, const PatchBatches& batches, const PatchArrays& of, const Double4* x,
                     double* det, double* squared_norm);

/// Adds their forces to f, a column for each node.
void add_patch_forces(int begin, int end, const PatchBatches& batches, const PatchArrays& of,
                      const Double4* x, Double4* f);

inline namespace TESTBED_KIND {
/// Second derivatives psi'' of an energy density by F in 3 x 3 blocks (a, b) of the columns a and b of F:
/// column a holds (a, 0), (a, 1) and (a, 2).
using Stiffness = Eigen::Matrix<double, 27, 3>;

/// Adds V sum_ab b_r(a) psi''(a, b) b_e(b) to the block at the next of the given places, for r = 0 ... n - 1,
/// and e = r ... n - 1.
/// @param V     volume (m3)
/// @param b     vectors b_0 ... b_n-1 of a patch, 3 numbers each (1/m)
/// @param at    places of n (n + 1) / 2 blocks
void add_patch_blocks(const Stiffness& psi, double V, const double* b, int n, const int* at,
                      Eigen::Matrix3d* block);
}  // namespace TESTBED_KIND

}  // namespace testbed::massspring
