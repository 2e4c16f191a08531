// Natural frequencies of small undamped motions about rest.
#pragma once

#include "massspring/model/model.h"

namespace testbed::massspring {

/// The n lowest f (Hz), ascending, of K x = (2 pi f)^2 M x on the directions that are free, 0 for rigid
/// motions, by Lanczos iteration on (K + s M)^-1 M, s > 0 small.
/// @throws std::runtime_error when K + s M has no Cholesky factor or the iteration does not converge.
Eigen::VectorXd natural_frequencies(const MassSpringModel& model, const std::vector<Constraint>& constraints,
                                    int n);

/// Mass-proportional damping (1/s) that damps the lowest vibration by `ratio` of what is critical: 2 ratio
/// omega.
/// @throws std::runtime_error as natural_frequencies does, and where the lowest 24 motions cost no energy.
double damping_of_ratio(const MassSpringModel& model, const std::vector<Constraint>& constraints,
                        double ratio);

}  // namespace testbed::massspring
