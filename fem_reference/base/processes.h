// Processes that solve one scene together, started by mpirun.
// Each holds its share of the mesh.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "meshing/base/mesh.h"

namespace testbed::fem {

struct Processes {
  int n = 1, rank = 0;
  int n_threads = 1;  ///< that each may use
  int n_here = 1;     ///< on this machine
};

/// One, unless mpirun (Open MPI) started several: then MPI runs from the first call on.
const Processes& processes();

/// Ends all processes; the first to fail speaks for all.
[[noreturn]] void abort_processes(const char* message);

/// Replaces values by their sum over the processes.
void sum_over_processes(Eigen::Ref<Eigen::VectorXd> values);
double sum_over_processes(double value);
double largest_over_processes(double value);
/// Diagonal of the box around the points of all.
double diagonal_over_processes(const Eigen::Matrix3Xd& X);

/// What process 0 has, on all.
Eigen::MatrixXi from_first_process(Eigen::MatrixXi values);
Eigen::MatrixXd from_first_process(Eigen::MatrixXd values);
int from_first_process(int value);
/// On process 0 what each has, in their order.
std::vector<double> to_first_process(double value);
std::vector<std::string> to_first_process(const std::string& text);

/// What this process has told others, by MPI's own calls.
struct Traffic {
  long messages = 0, bytes = 0;  ///< to one process
  long sums = 0;                 ///< over all
  double cpu = 0;                ///< s spent in calls, most of it waiting
};
Traffic traffic();

}  // namespace testbed::fem
