#include "fem_reference/elements/share.h"

#include <mpi.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <set>

#include "meshing/algebra/rigid_motion.h"
#include "meshing/surface/surface.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::MatrixXi;

/// Corners of the edges of a tetrahedron, in the order of VTK's quadratic one.
constexpr int kTetEdges[6][2] = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};

constexpr int kTag = 0;

MPI_Datatype type_of(double) {
  return MPI_DOUBLE;
}
MPI_Datatype type_of(float) {
  return MPI_FLOAT;
}
MPI_Datatype type_of(int) {
  return MPI_INT;
}

template <class Matrix>
void send(const Matrix& values, int to) {
  const int size[] = {static_cast<int>(values.rows()), static_cast<int>(values.cols())};
  MPI_Send(size, 2, MPI_INT, to, kTag, MPI_COMM_WORLD);
  MPI_Send(values.data(), static_cast<int>(values.size()), type_of(typename Matrix::Scalar()), to, kTag,
           MPI_COMM_WORLD);
}

template <class Matrix>
void receive(Matrix& values, int from) {
  int size[2];
  MPI_Recv(size, 2, MPI_INT, from, kTag, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
  values.resize(size[0], size[1]);
  MPI_Recv(values.data(), static_cast<int>(values.size()), type_of(typename Matrix::Scalar()), from, kTag,
           MPI_COMM_WORLD, MPI_STATUS_IGNORE);
}

/// Gives the nodes [begin, end) to n processes from the first on, across the longest side.
void bisect(const Matrix3Xd& X, int* begin, int* end, int first, int n, std::vector<int>& owner) {
  if (n == 1) {
    for (const int* i = begin; i != end; ++i) owner[*i] = first;
    return;
  }
  const auto nodes = X(Eigen::all, std::vector<int>(begin, end));
  Eigen::Index axis;
  (nodes.rowwise().maxCoeff() - nodes.rowwise().minCoeff()).maxCoeff(&axis);
  int* const middle = begin + (end - begin) * (n / 2) / n;
  std::nth_element(begin, middle, end,
                   [&](int i, int j) { return X(axis, i) != X(axis, j) ? X(axis, i) < X(axis, j) : i < j; });
  bisect(X, begin, middle, first, n / 2, owner);
  bisect(X, middle, end, first + n / 2, n - n / 2, owner);
}

/// What a process gets, in numbers of the whole mesh.
struct Hand {
  MatrixXi cells;   // those that it counts first
  MatrixXi nodes;   // of these, ascending; owner
  Matrix3Xd X;      // of vertices
  MatrixXi faces;   // number, corners
  MatrixXi counts;  // as in deal
  Eigen::MatrixXd volume;

  template <class Pass>
  void for_each(const Pass& pass) {
    pass(cells);
    pass(nodes);
    pass(X);
    pass(faces);
    pass(counts);
    pass(volume);
  }
};

/// The hands of a mesh, one at a time.
class Dealer {
 public:
  Dealer(const TetMesh& mesh, const Nodes& nodes, int n, const Joined& joined)
      : mesh_(mesh), nodes_(nodes), owner_(nodes.X.cols()) {
    std::vector<int> order(owner_.size());
    std::iota(order.begin(), order.end(), 0);
    bisect(nodes.X, order.data(), order.data() + order.size(), 0, n, owner_);
    const auto join = [&](const auto& columns) {
      for (const auto& column : columns.colwise())
        for (const int i : column)
          for (const int j : column)
            if (owner_[j] != owner_[i]) beside_[i].insert(owner_[j]);
    };
    if (joined.triangles) join(nodes.faces);
    join(joined.pairs);
    if (joined.surface)
      for (const int i : nodes.faces.reshaped())
        for (int p = 0; p < n; ++p) beside_[i].insert(p);
    counted_.resize(n);
    others_.resize(n);
    for (int t = 0; t < nodes.cells.cols(); ++t) {
      const int first = owner_[nodes.cells(0, t)];
      counted_[first].push_back(t);
      std::set<int> owners;
      for (const int i : nodes.cells.col(t)) {
        owners.insert(owner_[i]);
        if (const auto beside = beside_.find(i); beside != beside_.end())
          owners.insert(beside->second.begin(), beside->second.end());
      }
      for (const int owner : owners)
        if (owner != first) others_[owner].push_back(t);
    }
  }

  Hand hand(int process) const {
    std::vector<int> tets = counted_[process];
    tets.insert(tets.end(), others_[process].begin(), others_[process].end());
    Hand hand;
    hand.cells = nodes_.cells(Eigen::all, tets);
    std::vector<int> here(hand.cells.data(), hand.cells.data() + hand.cells.size());
    std::sort(here.begin(), here.end());
    here.erase(std::unique(here.begin(), here.end()), here.end());
    hand.nodes.resize(2, static_cast<Eigen::Index>(here.size()));
    for (std::size_t k = 0; k < here.size(); ++k)
      hand.nodes.col(static_cast<Eigen::Index>(k)) << here[k], owner_[here[k]];
    const auto n_vertices = std::lower_bound(here.begin(), here.end(), nodes_.n_vertices) - here.begin();
    hand.X = nodes_.X(Eigen::all, std::vector<int>(here.begin(), here.begin() + n_vertices));
    std::vector<int> faces;
    for (int f = 0; f < nodes_.faces.cols(); ++f) {
      const auto at = nodes_.faces.col(f);
      if (std::any_of(at.begin(), at.end(), [&](int i) { return is_in(i, process); })) faces.push_back(f);
    }
    hand.faces.resize(4, static_cast<Eigen::Index>(faces.size()));
    for (std::size_t k = 0; k < faces.size(); ++k)
      hand.faces.col(static_cast<Eigen::Index>(k)) << faces[k], mesh_.F.col(faces[k]);
    hand.counts.resize(4, 1);
    hand.counts << static_cast<int>(counted_[process].size()), static_cast<int>(nodes_.cells.cols()),
        static_cast<int>(nodes_.X.cols()), mesh_.n_surface;
    hand.volume = Eigen::MatrixXd::Constant(1, 1, volume(mesh_.X, mesh_.F));
    return hand;
  }

 private:
  /// Whether the share of a process has all that is at a node.
  bool is_in(int node, int process) const {
    const auto beside = beside_.find(node);
    return owner_[node] == process || (beside != beside_.end() && beside->second.count(process) > 0);
  }

  const TetMesh& mesh_;
  const Nodes& nodes_;
  std::vector<int> owner_;
  std::unordered_map<int, std::set<int>> beside_;   // processes that own a node joined to this one
  std::vector<std::vector<int>> counted_, others_;  // tetrahedra of each process
};

/// Takes a hand up.
Share share_of(const Hand& hand, int degree) {
  const Eigen::RowVectorXi numbers = hand.nodes.row(0);
  const auto place = [&](int node) {
    return static_cast<int>(std::lower_bound(numbers.begin(), numbers.end(), node) - numbers.begin());
  };
  TetMesh mesh;
  mesh.X = hand.X;
  mesh.T = hand.cells.topRows<4>().unaryExpr(place);
  mesh.F = hand.faces.bottomRows<3>().unaryExpr(place);
  mesh.n_surface = place(hand.counts(3));
  Share share(std::move(mesh));
  share.is_whole = false;
  share.n_own = hand.counts(0);
  share.n_tetrahedra = hand.counts(1);
  share.n_nodes = hand.counts(2);
  share.volume = hand.volume(0);
  share.face.assign(hand.faces.row(0).begin(), hand.faces.row(0).end());
  const Nodes nodes(share.mesh, degree);
  std::vector<int> owner(nodes.X.cols());
  share.number.resize(owner.size());
  share.is_ghost.resize(owner.size());
  for (Eigen::Index t = 0; t < nodes.cells.cols(); ++t)
    for (Eigen::Index a = 0; a < nodes.cells.rows(); ++a) {
      const int here = nodes.cells(a, t);
      share.number[here] = hand.cells(a, t);
      owner[here] = hand.nodes(1, place(hand.cells(a, t)));
      share.is_ghost[here] = owner[here] != processes().rank;
    }
  share.exchange = Exchange(share.number, owner);
  return share;
}

}  // namespace

Nodes::Nodes(const TetMesh& mesh, int degree) : n_vertices(static_cast<int>(mesh.X.cols())) {
  cells.resize(degree == 1 ? 4 : 10, mesh.T.cols());
  cells.topRows(4) = mesh.T;
  faces.resize(degree == 1 ? 3 : 6, mesh.F.cols());
  faces.topRows(3) = mesh.F;
  X = mesh.X;
  if (degree == 1) return;
  std::vector<std::array<int, 2>> ends;
  for (int t = 0; t < mesh.T.cols(); ++t)
    for (int e = 0; e < 6; ++e) {
      const int a = mesh.T(kTetEdges[e][0], t), b = mesh.T(kTetEdges[e][1], t);
      const auto [at, is_new] = middle_.try_emplace(key(a, b), n_vertices + static_cast<int>(ends.size()));
      if (is_new) ends.push_back({{a, b}});
      cells(4 + e, t) = at->second;
    }
  for (int f = 0; f < mesh.F.cols(); ++f)
    for (int e = 0; e < 3; ++e) faces(3 + e, f) = middle(mesh.F(e, f), mesh.F((e + 1) % 3, f));
  edges = Eigen::Map<const Eigen::Matrix2Xi>(ends.data()->data(), 2, static_cast<Eigen::Index>(ends.size()));
  X.conservativeResize(3, n_vertices + edges.cols());
  for (int e = 0; e < edges.cols(); ++e)
    X.col(n_vertices + e) = (X.col(edges(0, e)) + X.col(edges(1, e))) / 2;
}

Exchange::Exchange(const std::vector<int>& number, const std::vector<int>& owner) {
  const auto [n, rank, n_threads, n_here] = processes();
  std::unordered_map<int, int> here;
  std::vector<std::vector<std::pair<int, int>>> ghosts(n);  // their number and place, of each owner
  for (int i = 0; i < static_cast<int>(number.size()); ++i) {
    here[number[i]] = i;
    if (owner[i] != rank) ghosts[owner[i]].emplace_back(number[i], i);
  }
  std::vector<int> n_ghosts(n), n_asked(n);
  for (int p = 0; p < n; ++p) n_ghosts[p] = static_cast<int>(ghosts[p].size());
  MPI_Alltoall(n_ghosts.data(), 1, MPI_INT, n_asked.data(), 1, MPI_INT, MPI_COMM_WORLD);
  std::vector<std::vector<int>> wanted;
  std::vector<MPI_Request> requests;
  const auto expect = [&] { return &requests.emplace_back(); };
  for (int p = 0; p < n; ++p) {
    if (n_ghosts[p] + n_asked[p] == 0) continue;
    Neighbour& neighbour = neighbours_.emplace_back(Neighbour{p, std::vector<int>(n_asked[p]), {}});
    std::vector<int>& numbers = wanted.emplace_back();
    for (const auto& [node, at] : ghosts[p]) {
      numbers.push_back(node);
      neighbour.received.push_back(at);
    }
  }
  for (std::size_t k = 0; k < neighbours_.size(); ++k) {
    Neighbour& neighbour = neighbours_[k];
    MPI_Irecv(neighbour.sent.data(), static_cast<int>(neighbour.sent.size()), MPI_INT, neighbour.process,
              kTag, MPI_COMM_WORLD, expect());
    MPI_Isend(wanted[k].data(), static_cast<int>(wanted[k].size()), MPI_INT, neighbour.process, kTag,
              MPI_COMM_WORLD, expect());
  }
  MPI_Waitall(static_cast<int>(requests.size()), requests.data(), MPI_STATUSES_IGNORE);
  for (Neighbour& neighbour : neighbours_)
    for (int& node : neighbour.sent) node = here.at(node);
}

Exchange Exchange::over(const std::vector<int>& rank) const {
  Exchange result;
  for (const Neighbour& neighbour : neighbours_) {
    Neighbour& over = result.neighbours_.emplace_back(Neighbour{neighbour.process, {}, {}});
    for (const auto& [from, to] :
         {std::pair(&neighbour.sent, &over.sent), {&neighbour.received, &over.received}})
      for (const int node : *from)
        if (node < static_cast<int>(rank.size())) to->push_back(rank[node]);
  }
  return result;
}

template <class Field>
void Exchange::update_columns(Field& u) const {
  if (neighbours_.empty()) return;  // where MPI need not run
  constexpr int kRows = Field::RowsAtCompileTime;
  std::vector<Field> sent, received;
  std::vector<MPI_Request> requests(2 * neighbours_.size());
  const MPI_Datatype type = type_of(typename Field::Scalar());
  for (const Neighbour& neighbour : neighbours_) {
    sent.push_back(u(Eigen::all, neighbour.sent));
    received.emplace_back(kRows, static_cast<Eigen::Index>(neighbour.received.size()));
  }
  for (std::size_t k = 0; k < neighbours_.size(); ++k) {
    MPI_Irecv(received[k].data(), static_cast<int>(received[k].size()), type, neighbours_[k].process, kTag,
              MPI_COMM_WORLD, &requests[2 * k]);
    MPI_Isend(sent[k].data(), static_cast<int>(sent[k].size()), type, neighbours_[k].process, kTag,
              MPI_COMM_WORLD, &requests[2 * k + 1]);
  }
  MPI_Waitall(static_cast<int>(requests.size()), requests.data(), MPI_STATUSES_IGNORE);
  for (std::size_t k = 0; k < neighbours_.size(); ++k) u(Eigen::all, neighbours_[k].received) = received[k];
}

void Exchange::update(Matrix3Xd& u) const {
  update_columns(u);
}
void Exchange::update(Eigen::Matrix4Xf& u) const {
  update_columns(u);
}

Share::Share(TetMesh whole)
    : mesh(std::move(whole)),
      n_own(static_cast<int>(mesh.T.cols())),
      n_tetrahedra(n_own),
      volume(testbed::volume(mesh.X, mesh.F)) {}

std::unordered_map<int, int> Share::local() const {
  std::unordered_map<int, int> result;
  for (int i = 0; i < static_cast<int>(number.size()); ++i) result[number[i]] = i;
  return result;
}

std::vector<int> Share::owned(const std::vector<int>& nodes) const {
  if (is_whole) return nodes;
  const std::unordered_map<int, int> here = local();
  std::vector<int> result;
  for (const int node : nodes)
    if (const auto found = here.find(node); found != here.end() && !is_ghost[found->second])
      result.push_back(found->second);
  return result;
}

Eigen::MatrixXd Share::rigid_motions(const Matrix3Xd& X) const {
  if (is_whole) return meshing::rigid_motions(X);
  Eigen::Vector4d sum = Eigen::Vector4d::Zero();  // of owned nodes, and their number
  for (Eigen::Index i = 0; i < X.cols(); ++i)
    if (!is_ghost[i]) sum += X.col(i).homogeneous();
  sum_over_processes(sum);
  const Eigen::Vector3d centre = sum.hnormalized();
  return meshing::rigid_motions(X, centre,
                                largest_over_processes((X.colwise() - centre).colwise().norm().maxCoeff()));
}

bool Share::counts(const Eigen::VectorXi& nodes) const {
  return !is_ghost[*std::min_element(nodes.begin(), nodes.end(),
                                     [&](int i, int j) { return number[i] < number[j]; })];
}

double Share::dot(const Matrix3Xd& u, const Matrix3Xd& w) const {
  if (is_whole) return u.cwiseProduct(w).sum();
  double sum = 0;
  for (Eigen::Index i = 0; i < u.cols(); ++i)
    if (!is_ghost[i]) sum += u.col(i).dot(w.col(i));
  return sum_over_processes(sum);
}

double Share::norm(const Matrix3Xd& u) const {
  return std::sqrt(dot(u, u));
}

void Share::clear_ghosts(Matrix3Xd& u) const {
  for (std::size_t i = 0; i < is_ghost.size(); ++i)
    if (is_ghost[i]) u.col(static_cast<Eigen::Index>(i)).setZero();
}

Matrix3Xd Share::gather(const Matrix3Xd& u, int n) const {
  std::vector<int> own;
  for (int i = 0; i < static_cast<int>(is_ghost.size()); ++i)
    if (!is_ghost[i] && number[i] < n) own.push_back(i);
  MatrixXi numbers =
      Eigen::Map<const Eigen::VectorXi>(number.data(), static_cast<Eigen::Index>(number.size()))(own);
  Matrix3Xd values = u(Eigen::all, own);
  if (processes().rank > 0) {
    send(numbers, 0);
    send(values, 0);
    return Matrix3Xd(3, 0);
  }
  Matrix3Xd whole(3, n);
  for (int p = 0; p < processes().n; ++p) {
    if (p > 0) {
      receive(numbers, p);
      receive(values, p);
    }
    whole(Eigen::all, numbers.reshaped()) = values;
  }
  return whole;
}

/// Nodes here that are written behind the whole mesh's first n.
std::vector<int> Share::behind(int n) const {
  std::vector<int> nodes;
  for (int i = 0; i < static_cast<int>(number.size()); ++i)
    if (processes().rank > 0 || number[i] >= n) nodes.push_back(i);
  return nodes;
}

std::vector<int> Share::written_nodes(int n) const {
  if (is_whole) return {};
  std::vector<int> numbers(processes().rank == 0 ? n : 0);
  std::iota(numbers.begin(), numbers.end(), 0);
  for (const int i : behind(n)) numbers.push_back(number[i]);
  return numbers;
}

Matrix3Xd Share::written(const Matrix3Xd& u, int n) const {
  if (is_whole) return u;
  const Matrix3Xd first = gather(u, n), rest = u(Eigen::all, behind(n));
  Matrix3Xd result(3, first.cols() + rest.cols());
  result.leftCols(first.cols()) = first;
  result.rightCols(rest.cols()) = rest;
  return result;
}

MatrixXi Share::written_cells(const MatrixXi& cells, int n) const {
  if (is_whole) return cells;
  std::unordered_map<int, int> place;
  for (const int node : written_nodes(n)) place.emplace(node, static_cast<int>(place.size()));
  return cells.leftCols(n_own).unaryExpr([&](int i) { return place.at(number[i]); });
}

Share deal_out(TetMesh whole, int degree, const Joined& joined) {
  const auto [n, rank, n_threads, n_here] = processes();
  if (n == 1) return Share(std::move(whole));
  Hand hand;
  if (rank > 0) {
    hand.for_each([](auto& part) { receive(part, 0); });
    Share share = share_of(hand, degree);
    share.faces = from_first_process(MatrixXi());
    return share;
  }
  Nodes nodes(whole, degree);
  {
    const Dealer dealer(whole, nodes, n, joined);
    for (int p = n - 1; p >= 0; --p) {
      hand = dealer.hand(p);
      if (p > 0) hand.for_each([&](auto& part) { send(part, p); });
    }
  }
  whole = {};
  MatrixXi faces = std::move(nodes.faces);
  nodes = Nodes({}, 1);
  Share share = share_of(hand, degree);
  share.faces = from_first_process(std::move(faces));
  return share;
}

}  // namespace testbed::fem
