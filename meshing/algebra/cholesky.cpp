#include "meshing/algebra/cholesky.h"

#include <dlfcn.h>
#include <omp.h>

#include <Eigen/CholmodSupport>
#include <algorithm>
#include <new>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace testbed::meshing {

namespace {

/// With its factor laid open.
struct Supernodal : Eigen::CholmodSupernodalLLT<Eigen::SparseMatrix<double>> {
  const cholmod_factor& factor() const { return *m_cholmodFactor; }

  std::vector<int> order() const {
    const auto* first = static_cast<const int*>(factor().Perm);
    return {first, first + factor().n};
  }
  void analyse_in_order(const Eigen::SparseMatrix<double>& A, std::vector<int> order) {
    cholmod_free_factor(&m_cholmodFactor, &cholmod());
    cholmod_sparse pattern = Eigen::viewAsCholmod(A.selfadjointView<Eigen::Lower>());
    const int n_methods = std::exchange(cholmod().nmethods, 1),
              ordering = std::exchange(cholmod().method[0].ordering, CHOLMOD_GIVEN);
    m_cholmodFactor = cholmod_analyze_p(&pattern, order.data(), nullptr, 0, &cholmod());
    cholmod().nmethods = n_methods;
    cholmod().method[0].ordering = ordering;
  }
};

/// Of a compressed matrix.
struct Pattern {
  std::vector<int> outer, inner;

  explicit Pattern(const Eigen::SparseMatrix<double>& A)
      : outer(A.outerIndexPtr(), A.outerIndexPtr() + A.outerSize() + 1),
        inner(A.innerIndexPtr(), A.innerIndexPtr() + A.nonZeros()) {}
  bool is_of(const Eigen::SparseMatrix<double>& A) const {
    return A.nonZeros() == static_cast<Eigen::Index>(inner.size()) &&
           std::equal(outer.begin(), outer.end(), A.outerIndexPtr()) &&
           std::equal(inner.begin(), inner.end(), A.innerIndexPtr());
  }
};

/// OpenBLAS asks again and again, without end, where there is no room for its buffer, which it takes once.
void check_memory_of_blas() {
  constexpr std::size_t kBuffer = 136'000'000;  // byte
  static const bool kIsThere = [] {
    ::operator delete(::operator new(kBuffer));  // or throws
    return true;
  }();
  (void)kIsThere;
}

}  // namespace

double n_factor_entries(const BlockMatrix& A) {
  cholmod_common common;
  cholmod_start(&common);
  std::vector<int> start{0}, rows;  // of the upper triangle by columns, one entry a block
  for (int i = 0; i < A.rows(); ++i) {
    rows.insert(rows.end(), A.column.begin() + A.row_start[i], A.column.begin() + A.diagonal[i] + 1);
    start.push_back(static_cast<int>(rows.size()));
  }
  cholmod_sparse pattern{};
  pattern.nrow = pattern.ncol = static_cast<std::size_t>(A.rows());
  pattern.nzmax = rows.size();
  pattern.p = start.data();
  pattern.i = rows.data();
  pattern.stype = 1;
  pattern.itype = CHOLMOD_INT;
  pattern.xtype = CHOLMOD_PATTERN;
  pattern.sorted = pattern.packed = 1;
  cholmod_factor* factor = cholmod_analyze(&pattern, &common);
  const double n_blocks = common.lnz;
  cholmod_free_factor(&factor, &common);
  cholmod_finish(&common);
  return 9 * n_blocks;
}

struct SparseCholesky::Factor {
  explicit Factor(const Eigen::SparseMatrix<double>& A) : pattern(A) {}
  Supernodal llt;
  Pattern pattern;         ///< of the last matrix
  std::vector<int> order;  ///< of the first one
  double n_entries = 0;    ///< of its factor
};

SparseCholesky::SparseCholesky(const Eigen::SparseMatrix<double>& A) : factor_(std::make_unique<Factor>(A)) {
  // On two threads BLAS sums in another order: other bits, and seconds that are no longer those of one.
  // Looked up by name: other BLAS libraries lack it, and not every linker keeps a weak reference.
  if (void* const set_n_threads = dlsym(RTLD_DEFAULT, "openblas_set_num_threads"))
    reinterpret_cast<void (*)(int)>(set_n_threads)(1);
  factor_->llt.cholmod().print = 0;
  factor_->llt.analyzePattern(A);
  check_analysis();
  factor_->order = factor_->llt.order();
  factor_->n_entries = factor_->llt.cholmod().lnz;
  factorise(A);
}

SparseCholesky::~SparseCholesky() = default;
SparseCholesky::SparseCholesky(SparseCholesky&&) noexcept = default;
SparseCholesky& SparseCholesky::operator=(SparseCholesky&&) noexcept = default;

void SparseCholesky::update(const Eigen::SparseMatrix<double>& A) {
  constexpr double kMostGrowth = 1.2;
  if (!factor_->pattern.is_of(A)) {
    factor_->pattern = Pattern(A);
    factor_->llt.analyse_in_order(A, factor_->order);
    if (factor_->llt.cholmod().lnz > kMostGrowth * factor_->n_entries) factor_->llt.analyzePattern(A);
    check_analysis();
  }
  factorise(A);
}

void SparseCholesky::check_analysis() const {
  if (factor_->llt.cholmod().status < CHOLMOD_OK)  // Eigen does not look
    throw std::runtime_error("the Cholesky factor of " + std::to_string(factor_->pattern.outer.size() - 1) +
                             " unknowns is too large, expected fewer nodes");
}

void SparseCholesky::factorise(const Eigen::SparseMatrix<double>& A) {
  check_memory_of_blas();
  // CHOLMOD asks for four threads in its small loops whatever the machine and OMP_NUM_THREADS say; waiting
  // for each other they make a factorisation up to four times as long.
  const int levels = omp_get_max_active_levels();
  omp_set_max_active_levels(0);
  factor_->llt.factorize(A);
  omp_set_max_active_levels(levels);
}

bool SparseCholesky::is_ok() const {
  return factor_->llt.info() == Eigen::Success;
}

Eigen::MatrixXd SparseCholesky::solve(const Eigen::MatrixXd& b) const {
  return factor_->llt.solve(b);
}

SinglePrecisionFactor SparseCholesky::single_precision() const {
  const cholmod_factor& L = factor_->llt.factor();
  const auto* first = static_cast<const int*>(L.super);
  const auto* begin = static_cast<const int*>(L.pi);
  const auto* entries = static_cast<const int*>(L.px);
  const auto* row = static_cast<const int*>(L.s);
  const auto* permutation = static_cast<const int*>(L.Perm);
  SinglePrecisionFactor result;
  std::size_t n_entries = 0;
  for (std::size_t k = 0; k < L.nsuper; ++k) {
    const int n_columns = first[k + 1] - first[k], n_rows = begin[k + 1] - begin[k];
    const int height = (n_rows + 7) / 8 * 8;
    result.supernodes.push_back({first[k], n_columns, n_rows, height, result.row.size(), n_entries});
    result.row.insert(result.row.end(), row + begin[k] + n_columns, row + begin[k + 1]);
    n_entries += static_cast<std::size_t>(height) * n_columns;
  }
  result.entry.resize(n_entries);
  for (std::size_t k = 0; k < L.nsuper; ++k) {
    const SinglePrecisionFactor::Supernode& s = result.supernodes[k];
    for (int j = 0; j < s.n_columns; ++j) {
      const double* from =
          static_cast<const double*>(L.x) + entries[k] + static_cast<std::size_t>(j) * s.n_rows;
      float* to = &result.entry[s.entries + static_cast<std::size_t>(j) * s.height];
      std::transform(from + j + 1, from + s.n_rows, to + j + 1,
                     [](double e) { return static_cast<float>(e); });
      result.inverse.push_back(static_cast<float>(1 / from[j]));
    }
  }
  for (std::size_t k = 0; k < L.n; ++k)
    result.unknown.push_back(4 * (permutation[k] / 3) + permutation[k] % 3);
  return result;
}

namespace {

/// The lower triangle, of zeros.
Eigen::SparseMatrix<double> lower_pattern(const BlockMatrix& A) {
  Eigen::SparseMatrix<double> lower(3 * A.rows(), 3 * A.rows());
  std::vector<int> n_per_column(3 * A.rows());
  for (int i = 0; i < A.rows(); ++i)
    for (int c = 0; c < 3; ++c) n_per_column[3 * i + c] = 3 * (A.row_start[i + 1] - A.diagonal[i]) - c;
  lower.reserve(n_per_column);
  for (int i = 0; i < A.rows(); ++i)
    for (int c = 0; c < 3; ++c)
      for (int k = A.diagonal[i]; k < A.row_start[i + 1]; ++k)
        for (int r = A.column[k] == i ? c : 0; r < 3; ++r) lower.insert(3 * A.column[k] + r, 3 * i + c) = 0;
  lower.makeCompressed();
  return lower;
}

/// Values of the lower triangle.
void fill(const BlockMatrix& A, Eigen::SparseMatrix<double>& lower) {
  // Column 3 i + c of the lower triangle is row 3 i + c of the upper one: blocks j >= i of block row i.
  double* value = lower.valuePtr();
  for (int i = 0; i < A.rows(); ++i)
    for (int c = 0; c < 3; ++c)
      for (int k = A.diagonal[i]; k < A.row_start[i + 1]; ++k)
        for (int r = A.column[k] == i ? c : 0; r < 3; ++r) *value++ = A.block[k](c, r);
}

}  // namespace

BlockCholesky::BlockCholesky(const BlockMatrix& A) : n_blocks_(A.block.size()), lower_(lower_pattern(A)) {
  update(A);
}

void BlockCholesky::update(const BlockMatrix& A) {
  fill(A, lower_);
  if (factor_)
    factor_->update(lower_);
  else
    factor_.emplace(lower_);
}

void archive(Archive& a, BlockCholesky& cholesky) {
  Eigen::SparseMatrix<double>& lower = cholesky.lower_;
  const Eigen::Index n_entries = lower.nonZeros();
  std::vector<int> outer(lower.outerIndexPtr(), lower.outerIndexPtr() + lower.outerSize() + 1),
      inner(lower.innerIndexPtr(), lower.innerIndexPtr() + n_entries);
  std::vector<double> values(lower.valuePtr(), lower.valuePtr() + n_entries);
  a(cholesky.n_blocks_, outer, inner, values);
  if (!a.is_reading()) return;
  const auto n = static_cast<Eigen::Index>(outer.size()) - 1;
  lower = Eigen::Map<const Eigen::SparseMatrix<double>>(n, n, static_cast<Eigen::Index>(values.size()),
                                                        outer.data(), inner.data(), values.data());
  cholesky.factor_.emplace(lower);
}

void BlockCholesky::solve(const Eigen::Matrix3Xd& b, Eigen::Matrix3Xd& x) const {
  x = factor_->solve(b.reshaped()).reshaped(3, b.cols());
}

}  // namespace testbed::meshing
