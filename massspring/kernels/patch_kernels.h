// What coupled springs add to a matrix, the part of it that takes the time.
#pragma once

#include <Eigen/Core>

namespace testbed::massspring {

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

namespace plain {
/// The same in a plain loop, which a compiler without vectors runs.
void add_patch_blocks(const Stiffness& psi, double V, const double* b, int n, const int* at,
                      Eigen::Matrix3d* block);
}  // namespace plain

}  // namespace testbed::massspring
