#include "fem_reference/base/processes.h"

#include <deal.II/base/mpi.h>
#include <deal.II/base/multithread_info.h>

#include <chrono>
#include <cstdlib>
#include <iostream>
#include <thread>

namespace testbed::fem {
namespace {

template <class Matrix>
void broadcast(Matrix& values, MPI_Datatype type) {
  long columns = values.cols();
  MPI_Bcast(&columns, 1, MPI_LONG, 0, MPI_COMM_WORLD);
  values.resize(Eigen::NoChange, columns);
  MPI_Bcast(values.data(), static_cast<int>(values.size()), type, 0, MPI_COMM_WORLD);
}

}  // namespace

void start_mpi() {
  static int argc = 0;
  static char** argv = nullptr;
  static dealii::Utilities::MPI::MPI_InitFinalize mpi(argc, argv, 1);
}

const Processes& processes() {
  static const Processes kResult = [] {
    const char* size = std::getenv("OMPI_COMM_WORLD_SIZE");
    Processes started;
    started.n_threads = static_cast<int>(dealii::MultithreadInfo::n_threads());
    if (!size || std::atoi(size) <= 1) return started;
    start_mpi();
    MPI_Comm_size(MPI_COMM_WORLD, &started.n);
    MPI_Comm_rank(MPI_COMM_WORLD, &started.rank);
    started.n_threads = 1;
    return started;
  }();
  return kResult;
}

void abort_processes(const char* message) {
  // An error that all meet is the first process' to tell, which ends the others meanwhile.
  if (processes().rank > 0) std::this_thread::sleep_for(std::chrono::seconds(3));
  std::cerr << "error: " << message << std::endl;
  MPI_Abort(MPI_COMM_WORLD, 1);
  std::abort();
}

void sum_over_processes(Eigen::Ref<Eigen::VectorXd> values) {
  if (processes().n > 1)
    MPI_Allreduce(MPI_IN_PLACE, values.data(), static_cast<int>(values.size()), MPI_DOUBLE, MPI_SUM,
                  MPI_COMM_WORLD);
}

double largest_over_processes(double value) {
  if (processes().n > 1) MPI_Allreduce(MPI_IN_PLACE, &value, 1, MPI_DOUBLE, MPI_MAX, MPI_COMM_WORLD);
  return value;
}

TetMesh from_first_process(TetMesh mesh) {
  if (processes().n > 1) {
    broadcast(mesh.X, MPI_DOUBLE);
    broadcast(mesh.T, MPI_INT);
    broadcast(mesh.F, MPI_INT);
    MPI_Bcast(&mesh.n_surface, 1, MPI_INT, 0, MPI_COMM_WORLD);
  }
  return mesh;
}

bool from_first_process(bool value) {
  int number = value;
  if (processes().n > 1) MPI_Bcast(&number, 1, MPI_INT, 0, MPI_COMM_WORLD);
  return number != 0;
}

}  // namespace testbed::fem
