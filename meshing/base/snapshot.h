// What a solver has found at a time or load factor.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// A value per node: components x n_nodes.
struct Field {
  std::string name;
  Eigen::MatrixXd values;
};

/// At small strain. What strains more is no small strain: such a run ends.
inline constexpr double kLargestSmallStrain = 1;

struct Snapshot {
  double time, load_factor;                                  ///< s or, in statics, load factor; of the loads
  Eigen::Matrix3Xd u;                                        ///< displacement of the nodes (m)
  double kinetic_energy, elastic_energy;                     ///< J
  std::vector<std::pair<std::string, double>> strains;       ///< by their names
  std::vector<Field> fields = {};                            ///< besides displacement
  std::vector<std::pair<std::string, double>> contact = {};  ///< contact_columns
  std::vector<std::pair<std::string, double>> ledger = {};   ///< of motion: EnergyLedger::columns (J)
  std::optional<double> max_displacement = {};               ///< m, where u is that of some nodes alone
};

}  // namespace testbed::meshing
