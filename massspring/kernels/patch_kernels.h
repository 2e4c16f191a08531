// The sums of coupled springs, for registers: batches of patches side by side, nodes padded to four doubles.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "meshing/algebra/block_matrix.h"
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
  /// Of each batch's pairs of entries (r, e), r <= e, and the end.
  std::vector<int> pair_start;

  int n_batches() const { return static_cast<int>(first.size()) - 1; }
};

/// Constants of each patch.
struct PatchArrays {
  const double* volume;  ///< m3
  const double* lambda;  ///< Pa
  const double* scale;   ///< of the rest shape; null: ones
  double mu;             ///< Pa
};

/// det F - 1 and |F|^2 - 3 of the patches of batches begin to end - 1, from the first place on.
/// @param u  displacement (m), a column for each node
void measure_patches(int begin, int end, const PatchBatches& batches, const PatchArrays& of, const Double4* u,
                     double* det_1, double* squares_3);

/// Adds their forces to f, a column for each node.
void add_patch_forces(int begin, int end, const PatchBatches& batches, const PatchArrays& of,
                      const Double4* u, Double4* f);

/// Adds the forces of small displacements u, linear in these, about rest lengths that have not shrunk.
void add_linear_patch_forces(int begin, int end, const PatchBatches& batches, const PatchArrays& of,
                             const Double4* u, Double4* f);

/// Patches in single precision, beside the batches that they are of.
struct SinglePatches {
  std::vector<float> b;           ///< as those of the batches
  std::vector<float> lambda, mu;  ///< kBatchSize of each batch: Lame's constants times the volume (J)
};
SinglePatches single_precision(const PatchBatches& batches, const PatchArrays& of);

/// y += K p of batches begin to end - 1, K the Hessian of their energies at rest; 4 floats for each node.
void add_patch_products(int begin, int end, const PatchBatches& batches, const SinglePatches& of,
                        const float* p, float* y);

/// Adds the blocks of the Hessian of their energies (N/m) to those at given places: of batches begin to end - 1,
/// projected patch by patch where that is asked for.
/// @param at  of each pair of entries (r, e), r <= e, of a batch those of its patches, from the first batch on
void add_patch_hessians(int begin, int end, const PatchBatches& batches, const PatchArrays& of,
                        const Double4* u, Curvature curvature, const int* at, Eigen::Matrix3d* block);

}  // namespace testbed::massspring
