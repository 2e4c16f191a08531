#include "fem_reference/base/processes.h"

#include <deal.II/base/mpi.h>
#include <deal.II/base/multithread_info.h>

#include <chrono>
#include <cstdlib>
#include <ctime>
#include <iostream>
#include <numeric>
#include <string>
#include <thread>

namespace testbed::fem {
namespace {

Traffic told;

void count_message(int n, MPI_Datatype type) {
  int size = 0;
  PMPI_Type_size(type, &size);
  ++told.messages;
  told.bytes += static_cast<long>(n) * size;
}

double thread_seconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

template <class Call>
int timed(const Call& call) {
  const double begin = thread_seconds();
  const int error = call();
  told.cpu += thread_seconds() - begin;
  return error;
}

template <class Matrix>
Matrix broadcast(Matrix values, MPI_Datatype type) {
  if (processes().n == 1) return values;
  int size[] = {static_cast<int>(values.rows()), static_cast<int>(values.cols())};
  MPI_Bcast(size, 2, MPI_INT, 0, MPI_COMM_WORLD);
  values.resize(size[0], size[1]);
  MPI_Bcast(values.data(), static_cast<int>(values.size()), type, 0, MPI_COMM_WORLD);
  return values;
}

}  // namespace

const Processes& processes() {
  static const Processes kResult = [] {
    const char* size = std::getenv("OMPI_COMM_WORLD_SIZE");
    Processes started;
    started.n_threads = static_cast<int>(dealii::MultithreadInfo::n_threads());
    if (!size || std::atoi(size) <= 1) return started;
    int argc = 0;
    char** argv = nullptr;
    static dealii::Utilities::MPI::MPI_InitFinalize mpi(argc, argv, 1);  // until the program ends
    MPI_Comm_size(MPI_COMM_WORLD, &started.n);
    MPI_Comm_rank(MPI_COMM_WORLD, &started.rank);
    started.n_threads = 1;
    MPI_Comm here;
    MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &here);
    MPI_Comm_size(here, &started.n_here);
    MPI_Comm_free(&here);
    return started;
  }();
  return kResult;
}

void abort_processes(const char* message) {
  // An error that all meet is the first process' to tell, which ends the others meanwhile.
  if (processes().rank > 0) std::this_thread::sleep_for(std::chrono::seconds(3));
  std::cerr << "error: " + std::string(message) + '\n';  // at once, or lines of mpirun come between
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

double diagonal_over_processes(const Eigen::Matrix3Xd& X) {
  Eigen::Vector3d sides;
  for (int c = 0; c < 3; ++c)
    sides(c) = largest_over_processes(X.row(c).maxCoeff()) + largest_over_processes(-X.row(c).minCoeff());
  return sides.norm();
}

double sum_over_processes(double value) {
  if (processes().n > 1) MPI_Allreduce(MPI_IN_PLACE, &value, 1, MPI_DOUBLE, MPI_SUM, MPI_COMM_WORLD);
  return value;
}

Eigen::MatrixXi from_first_process(Eigen::MatrixXi values) {
  return broadcast(std::move(values), MPI_INT);
}

Eigen::MatrixXd from_first_process(Eigen::MatrixXd values) {
  return broadcast(std::move(values), MPI_DOUBLE);
}

int from_first_process(int value) {
  if (processes().n > 1) MPI_Bcast(&value, 1, MPI_INT, 0, MPI_COMM_WORLD);
  return value;
}

std::vector<double> to_first_process(double value) {
  std::vector<double> values(processes().n, value);
  if (processes().n > 1) MPI_Gather(&value, 1, MPI_DOUBLE, values.data(), 1, MPI_DOUBLE, 0, MPI_COMM_WORLD);
  return values;
}

std::vector<std::string> to_first_process(const std::string& text) {
  const std::vector<double> sizes = to_first_process(static_cast<double>(text.size()));
  if (processes().n == 1) return {text};
  std::vector<int> n(sizes.begin(), sizes.end()), begin(n.size() + 1);
  std::partial_sum(n.begin(), n.end(), begin.begin() + 1);
  std::string all(begin.back(), ' ');
  MPI_Gatherv(text.data(), static_cast<int>(text.size()), MPI_CHAR, all.data(), n.data(), begin.data(),
              MPI_CHAR, 0, MPI_COMM_WORLD);
  if (processes().rank > 0) return {};
  std::vector<std::string> texts;
  for (std::size_t p = 0; p < n.size(); ++p) texts.push_back(all.substr(begin[p], n[p]));
  return texts;
}

Traffic traffic() {
  return told;
}

}  // namespace testbed::fem

// MPI's profiling interface: calls of all libraries come by here.
using testbed::fem::count_message;
using testbed::fem::timed;
using testbed::fem::told;

int MPI_Send(const void* from, int n, MPI_Datatype type, int to, int tag, MPI_Comm comm) {
  count_message(n, type);
  return timed([&] { return PMPI_Send(from, n, type, to, tag, comm); });
}
int MPI_Rsend(const void* from, int n, MPI_Datatype type, int to, int tag, MPI_Comm comm) {
  count_message(n, type);
  return timed([&] { return PMPI_Rsend(from, n, type, to, tag, comm); });
}
int MPI_Isend(const void* from, int n, MPI_Datatype type, int to, int tag, MPI_Comm comm,
              MPI_Request* request) {
  count_message(n, type);
  return timed([&] { return PMPI_Isend(from, n, type, to, tag, comm, request); });
}
int MPI_Recv(void* to, int n, MPI_Datatype type, int from, int tag, MPI_Comm comm, MPI_Status* status) {
  return timed([&] { return PMPI_Recv(to, n, type, from, tag, comm, status); });
}
int MPI_Wait(MPI_Request* request, MPI_Status* status) {
  return timed([&] { return PMPI_Wait(request, status); });
}
int MPI_Waitall(int n, MPI_Request* requests, MPI_Status* statuses) {
  return timed([&] { return PMPI_Waitall(n, requests, statuses); });
}
int MPI_Bcast(void* values, int n, MPI_Datatype type, int root, MPI_Comm comm) {
  return timed([&] { return PMPI_Bcast(values, n, type, root, comm); });
}
int MPI_Barrier(MPI_Comm comm) {
  return timed([&] { return PMPI_Barrier(comm); });
}
int MPI_Allreduce(const void* from, void* to, int n, MPI_Datatype type, MPI_Op op, MPI_Comm comm) {
  ++told.sums;
  return timed([&] { return PMPI_Allreduce(from, to, n, type, op, comm); });
}
