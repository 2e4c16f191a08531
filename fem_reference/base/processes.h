// Processes that solve one scene together, started by mpirun.
// Each holds the whole mesh and a part of the cells.
#pragma once

#include <Eigen/Core>

#include "meshing/base/mesh.h"

namespace testbed::fem {

struct Processes {
  int n = 1, rank = 0;
  int n_threads = 1;  ///< that each may use
};

/// One, unless mpirun (Open MPI) started several: then MPI runs from the first call on.
const Processes& processes();

/// Starts MPI, if it does not run, until the program ends.
void start_mpi();

/// Ends all processes; the first to fail speaks for all.
[[noreturn]] void abort_processes(const char* message);

/// Replaces values by their sum over the processes.
void sum_over_processes(Eigen::Ref<Eigen::VectorXd> values);
double largest_over_processes(double value);

/// What process 0 has, on all.
TetMesh from_first_process(TetMesh mesh);
bool from_first_process(bool value);

}  // namespace testbed::fem
