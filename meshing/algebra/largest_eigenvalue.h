// How fast an explicit step may be: the largest eigenvalue of an operator that is known by its products.
#pragma once

#include <Eigen/Core>
#include <functional>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// Largest eigenvalue of a symmetric operator on 3 x n by Lanczos's iteration [Lanczos 1950], to 1e-3. What
/// the iteration knows of its own error is added, so that it errs upwards.
/// @param product  returns the operator times q
/// @param start    of the iteration, with a part of every vector that counts; not zero
/// @param dot      of two such fields, that of Euclid where it is empty
double largest_eigenvalue(
    const std::function<Eigen::Matrix3Xd(const Eigen::Matrix3Xd& q)>& product, const Eigen::Matrix3Xd& start,
    const std::function<double(const Eigen::Matrix3Xd& a, const Eigen::Matrix3Xd& b)>& dot = {});

}  // namespace testbed::meshing
