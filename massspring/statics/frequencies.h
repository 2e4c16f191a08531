// Natural frequencies of small undamped motions about rest.
#pragma once

#include "massspring/model/model.h"

namespace testbed::massspring {

struct NaturalFrequencies {
  Eigen::VectorXd frequency;  ///< Hz, ascending, of vibrations
  int n_zero = 0;             ///< motions without energy besides: rigid ones, and floppy ones of a mechanism
};

/// The n lowest f of K x = (2 pi f)^2 M x on the directions that are free, by lowest_modes; fewer where there
/// are no more. K is that of the model, of handles and of enclosed volumes; contact and loads have no part in it.
/// @throws std::runtime_error when K + s M, s > 0 small, has no Cholesky factor or the iteration does not
/// converge.
NaturalFrequencies natural_frequencies(const MassSpringModel& model, const Forces& forces, int n);

/// Mass-proportional damping (1/s) that damps the lowest vibration by `ratio` of what is critical: 2 ratio
/// omega.
/// @throws std::runtime_error as natural_frequencies does, and where no motion costs energy.
double damping_of_ratio(const MassSpringModel& model, const Forces& forces, double ratio);

}  // namespace testbed::massspring
