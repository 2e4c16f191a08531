// Node vectors in single precision, for work that memory bounds: half the bytes, and registers full of lanes.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// 4 x n of node vectors and a row of zeros, with as many columns of zeros at the end as make n a multiple
/// of four, so that the widest registers are full. Sums over nodes are added in double precision, in an
/// order that no machine changes.
using PaddedField = Eigen::Matrix4Xf;

/// Symmetric blocks at nodes, as columns of their diagonal xx yy zz and of xy yz zx.
struct SymmetricBlocks {
  PaddedField diagonal, off_diagonal;
};

/// Number of columns of n nodes.
inline Eigen::Index padded(Eigen::Index n) {
  return (n + 3) / 4 * 4;
}

/// factor u, 3 x n, in single precision.
void pad(const Eigen::Matrix3Xd& u, double factor, PaddedField& result);

/// u += factor w.
void add_unpadded(const PaddedField& w, double factor, Eigen::Matrix3Xd& u);

SymmetricBlocks pad(const std::vector<Eigen::Matrix3d>& blocks);

/// Over the columns of u.
double dot(const PaddedField& u, const PaddedField& w);

/// z = D r; r . z.
double multiply(const SymmetricBlocks& D, const PaddedField& r, PaddedField& z);

/// x += alpha p, r -= alpha Ap; r . r.
double advance(float alpha, const PaddedField& p, const PaddedField& Ap, PaddedField& x, PaddedField& r);

/// y = p, each node times its factor.
void multiply(const Eigen::VectorXf& factor, const PaddedField& p, PaddedField& y);

/// p = z + beta p.
void aypx(float beta, const PaddedField& z, PaddedField& p);

/// y += alpha u on the columns of u.
void add_scaled(float alpha, const PaddedField& u, PaddedField& y);

/// y += A p, A the 3 x 3 blocks of compressed rows by columns and three floats at the end; then p . y.
double add_product(const std::vector<int>& row_start, const std::vector<int>& column,
                   const std::vector<float>& blocks, const PaddedField& p, PaddedField& y);

}  // namespace testbed::meshing
