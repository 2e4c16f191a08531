#include <algorithm>
#include <cstring>
#include <stdexcept>

#include "meshing/base/files.h"
#include "meshing/tetrahedra/tet_worker.h"

namespace testbed::meshing {

namespace {

template <class Matrix>
void append(std::string& bytes, const Matrix& matrix) {
  const long n = matrix.cols();
  bytes.append(reinterpret_cast<const char*>(&n), sizeof(n));
  bytes.append(reinterpret_cast<const char*>(matrix.data()), matrix.size() * sizeof(matrix(0, 0)));
}

template <class Matrix>
Matrix take(const std::string& bytes, size_t& at) {
  long n = -1;
  const auto column = static_cast<size_t>(Matrix::RowsAtCompileTime) * sizeof(typename Matrix::Scalar);
  if (bytes.size() - at >= sizeof(n)) std::memcpy(&n, bytes.data() + at, sizeof(n));
  if (n < 0 || static_cast<size_t>(n) > (bytes.size() - at - sizeof(n)) / column)
    throw std::runtime_error("what the mesher wrote is damaged or cut");
  at += sizeof(n);
  Matrix matrix(Matrix::RowsAtCompileTime, n);
  const size_t size = matrix.size() * sizeof(matrix(0, 0));
  std::copy_n(bytes.data() + at, size,
              reinterpret_cast<char*>(matrix.data()));  // takes the null of no columns
  at += size;
  return matrix;
}

}  // namespace

void write_task(const std::filesystem::path& file, const TetTask& task) {
  std::string bytes;
  append(bytes, task.surface.X);
  append(bytes, task.surface.F);
  append(bytes, task.interior);
  append(bytes, Eigen::RowVectorXd(task.size.transpose()));
  append(bytes, Eigen::Matrix<double, 1, 1>(task.longest));
  write_file(file, bytes);
}

TetTask read_task(const std::filesystem::path& file) {
  const std::string bytes = read_file(file);
  size_t at = 0;
  TetTask task;
  task.surface.X = take<Eigen::Matrix3Xd>(bytes, at);
  task.surface.F = take<Eigen::Matrix3Xi>(bytes, at);
  task.interior = take<Eigen::Matrix3Xd>(bytes, at);
  task.size = take<Eigen::RowVectorXd>(bytes, at).transpose();
  task.longest = take<Eigen::RowVectorXd>(bytes, at)(0);
  return task;
}

void write_nodes(const std::filesystem::path& file, const TetNodes& nodes) {
  std::string bytes;
  append(bytes, nodes.X);
  append(bytes, nodes.T);
  write_file(file, bytes);
}

TetNodes read_nodes(const std::filesystem::path& file) {
  const std::string bytes = read_file(file);
  size_t at = 0;
  TetNodes nodes;
  nodes.X = take<Eigen::Matrix3Xd>(bytes, at);
  nodes.T = take<Eigen::Matrix4Xi>(bytes, at);
  return nodes;
}

}  // namespace testbed::meshing
