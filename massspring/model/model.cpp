#include "massspring/model/model.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <limits>
#include <map>
#include <sstream>
#include <stdexcept>

#include "massspring/energies/tractions.h"
#include "meshing/algebra/subdomains.h"
#include "meshing/base/geometry.h"
#include "meshing/surface/surface.h"
#include "meshing/surface_energies/follower_pressure.h"
#include "meshing/surface_energies/handles.h"

namespace testbed::massspring {
Eigen::Matrix3Xd displacement(const MassSpringModel& model, const State& state) {
  if (state.u.size() > 0) return state.u;
  return state.x - model.network.X;
}

State initial_state(const MassSpringModel& model) {
  State state;
  state.x = model.network.X;
  state.v = Eigen::Matrix3Xd::Zero(3, state.x.cols());
  state.target_volume = volume(state.x, model.network.F);
  if (!model.springs) return state;
  const Eigen::Matrix2Xi& E = model.springs->E;
  state.rest_length.resize(E.cols());
  for (int s = 0; s < E.cols(); ++s)
    state.rest_length(s) = (state.x.col(E(0, s)) - state.x.col(E(1, s))).norm();
  return state;
}

SurfaceMesh surface_of(const MassSpringModel& model) {
  const TetMesh& network = model.network;
  return {network.X.leftCols(network.n_surface), network.F, model.cuts};
}

std::vector<Constraint> constraints_of(const SurfaceProblem& problem, const SurfaceMesh& surface, double t) {
  struct Constrained {
    Constraint constraint;
    bool is_oblique, is_moved;
  };
  std::map<int, Constrained> of_node;
  for (const auto& [vertices, support] : problem.constrained) {
    if (!holds_at(support, t)) continue;
    const auto motion = support.motion.empty() ? nullptr : std::make_shared<const Path>(support.motion);
    const bool is_oblique = support.normal || support.along;
    const bool is_moved = motion || !support.displacement.isZero(0);
    for (const int i : vertices) {
      const auto [found, is_first] = of_node.try_emplace(
          i, Constrained{{i, Eigen::Matrix3d::Identity(), Eigen::Vector3d::Zero()}, is_oblique, is_moved});
      auto& [c, was_oblique, was_moved] = found->second;
      was_oblique |= is_oblique;
      was_moved |= is_moved;
      if (!is_first && was_oblique && was_moved) {
        std::ostringstream what;
        what << "two supports hold the node at (" << surface.X.col(i).transpose()
             << ") m, one by normal or along, expected that neither moves it";
        throw std::runtime_error(what.str());
      }
      for (const Eigen::Vector3d& direction : constrained_directions(support)) {
        constexpr double kNone = 1e-6;  // of a direction that is still free
        const Eigen::Vector3d free = c.S * direction;
        if (free.norm() > kNone) c.S -= free * free.transpose() / free.squaredNorm();
      }
      for (int k = 0; k < 3; ++k)
        if (is_oblique || support.fixed[k]) {
          c.displacement(k) = support.displacement(k);
          c.motion[k] = motion;
        }
    }
  }
  std::vector<Constraint> constraints;
  for (const auto& [node, constrained] : of_node) constraints.push_back(constrained.constraint);
  return constraints;
}

Forces forces_of(const Scene& scene, const SurfaceProblem& problem, const MassSpringModel& model, double t) {
  const TetMesh& network = model.network;
  const SurfaceMesh surface = surface_of(model);
  Forces forces;
  forces.mass_damping = scene.material.damping;
  forces.load = Eigen::Matrix3Xd::Zero(3, network.X.cols());
  if (const auto gravity = gravity_of(scene)) forces.load += *gravity * model.mass.transpose();
  const Eigen::VectorXd areas = area_vectors(surface.X, surface.F).colwise().norm();
  for (int f = 0; f < surface.F.cols(); ++f)
    for (const int i : surface.F.col(f)) forces.load.col(i) += areas(f) / 3 * problem.traction.col(f);
  for (const auto& [triangles, terms] : problem.stressed)
    forces.load.leftCols(network.n_surface) +=
        traction_forces([&terms = terms](const Eigen::Vector3d& x) { return stress_at(terms, x); }, surface.X,
                        surface.F(Eigen::all, triangles));
  forces.surface = followers_of(problem.follower_pressure, surface.F);
  if (scene.volume && scene.volume->coefficient > 0)
    add_volume_penalty(scene.volume->coefficient, model, forces);
  if (scene.volume && scene.volume->is_exact)
    forces.surface.push_back(std::make_shared<HeldVolume>(
        model.material.E, Faces{network.F}, target_volume_of(scene, volume(network.X, network.F))));
  for (auto& handle : meshing::handles_of(problem, network.X, Eigen::Matrix3d::Identity(), t))
    forces.surface.push_back(std::move(handle));
  forces.constraints = constraints_of(problem, surface);
  return forces;
}

void add_volume_penalty(double P, const MassSpringModel& model, Forces& forces) {
  const Eigen::Matrix3Xi& F = model.network.F;
  forces.volume = std::make_shared<VolumePenalty>(P, Faces{F}, volume(model.network.X, F));
  forces.surface.push_back(forces.volume);
}

const SurfaceEnergies& surface_at(const Forces& forces, const State& state, double load_factor) {
  if (forces.volume) forces.volume->set_target(state.target_volume);
  for (const auto& energy : forces.surface) energy->set_load_factor(load_factor);
  return forces.surface;
}

void add_skin(const Skin& skin, MassSpringModel& model) {
  const auto& [X, T, F, n_surface] = model.network;
  if (skin.bending > 0) model.bending = make_bending(X, F, skin.bending);
  if (skin.stiffness > 0) {
    if (!model.springs) model.springs = Springs{edges_of(F), Eigen::VectorXd::Zero(F.cols() * 3 / 2)};
    std::map<std::pair<int, int>, double> areas;
    for (const auto& t : F.colwise()) {
      const double area = (X.col(t(1)) - X.col(t(0))).cross(X.col(t(2)) - X.col(t(0))).norm() / 2;
      for (int k = 0; k < 3; ++k) areas[std::minmax(t(k), t((k + 1) % 3))] += area;
    }
    Springs& springs = *model.springs;
    const auto stiffness_of = [&](const auto& edge) {
      const auto& [nodes, area] = edge;
      return skin.stiffness * area / (X.col(nodes.first) - X.col(nodes.second)).squaredNorm();
    };
    Eigen::Index n = springs.E.cols();
    for (Eigen::Index s = 0; s < n; ++s) {
      const auto edge = areas.find(std::minmax(springs.E(0, s), springs.E(1, s)));
      if (edge == areas.end()) continue;
      springs.stiffness(s) += stiffness_of(*edge);
      areas.erase(edge);
    }
    if (areas.empty()) return;
    springs.E.conservativeResize(2, n + static_cast<Eigen::Index>(areas.size()));
    springs.stiffness.conservativeResize(springs.E.cols());
    springs.first.clear();
    for (const auto& edge : areas) {
      springs.E.col(n) << edge.first.first, edge.first.second;
      springs.stiffness(n++) = stiffness_of(edge);
    }
  }
}

void add_momenta(const MassSpringModel& model, double factor, const Eigen::Matrix3Xd& v,
                 Eigen::Matrix3Xd& p) {
  for_each_chunk(v.cols(), [&](Eigen::Index begin, Eigen::Index end) {
    const Eigen::Index m = end - begin;
    p.middleCols(begin, m) += factor * v.middleCols(begin, m) * model.mass.segment(begin, m).asDiagonal();
  });
  if (model.consistent_mass) add_product(*model.consistent_mass, -factor, v, p);
}

Eigen::Matrix3Xd momenta(const MassSpringModel& model, const Eigen::Matrix3Xd& v) {
  Eigen::Matrix3Xd p = Eigen::Matrix3Xd::Zero(3, v.cols());
  add_momenta(model, 1, v, p);
  return p;
}

double kinetic_energy(const MassSpringModel& model, const Eigen::Matrix3Xd& v) {
  return v.cwiseProduct(momenta(model, v)).sum() / 2;
}

namespace {

// What an energy takes of the state besides the positions. One that takes nothing else needs no line here.

template <class Energy>
double energy_at(const MassSpringModel&, const State& state, const Energy& of) {
  return energy(of, state.x);
}
double energy_at(const MassSpringModel&, const State& state, const Springs& of) {
  return energy(of, state.rest_length, state.x);
}
double energy_at(const MassSpringModel& model, const State& state, const TetSprings& of) {
  return energy(of, displacement(model, state), state.patch_scale);
}

template <class Energy>
void add_forces_at(const MassSpringModel&, const State& state, const Energy& of, Eigen::Matrix3Xd& f) {
  add_forces(of, state.x, f);
}
void add_forces_at(const MassSpringModel&, const State& state, const Springs& of, Eigen::Matrix3Xd& f) {
  add_forces(of, state.rest_length, state.x, f);
}
void add_forces_at(const MassSpringModel& model, const State& state, const TetSprings& of,
                   Eigen::Matrix3Xd& f) {
  if (state.u.size() > 0) return add_forces(of, state.u, f, state.patch_scale);
  thread_local Eigen::Matrix3Xd u;  // kept, so that a step allocates nothing
  u = state.x - model.network.X;
  add_forces(of, u, f, state.patch_scale);
}

template <class Energy>
void add_hessian_at(const MassSpringModel&, const State& state, const Energy& of, BlockMatrix& K,
                    Curvature curvature) {
  add_hessian(of, state.x, K, curvature);
}
void add_hessian_at(const MassSpringModel&, const State& state, const Springs& of, BlockMatrix& K,
                    Curvature curvature) {
  add_hessian(of, state.rest_length, state.x, K, curvature);
}
void add_hessian_at(const MassSpringModel& model, const State& state, const TetSprings& of, BlockMatrix& K,
                    Curvature curvature) {
  add_hessian(of, displacement(model, state), K, curvature, state.patch_scale);
}

void add_elastic_forces(const MassSpringModel& model, const State& state, Eigen::Matrix3Xd& f) {
  if (model.linear) return add_linear_forces(model, state, displacement(model, state), f);
  for_each_energy(model, [&](const auto& energy) { add_forces_at(model, state, energy, f); });
}

}  // namespace

int n_energies(const MassSpringModel& model) {
  int n = 0;
  for_each_energy(model, [&](const auto&) { ++n; });
  return n;
}

double elastic_energy(const MassSpringModel& model, const State& state) {
  if (model.linear) return linear_energy(model, state, displacement(model, state));
  double sum = 0;
  for_each_energy(model, [&](const auto& energy) { sum += energy_at(model, state, energy); });
  return sum;
}

double energy_of_rest_lengths(const MassSpringModel& model, const State& state) {
  if (model.linear) return elastic_energy(model, state);
  return (model.springs ? energy_at(model, state, *model.springs) : 0) +
         (model.tet_springs ? energy_at(model, state, *model.tet_springs) : 0);
}

Eigen::Matrix3Xd elastic_forces(const MassSpringModel& model, const State& state) {
  Eigen::Matrix3Xd f = Eigen::Matrix3Xd::Zero(3, state.x.cols());
  add_elastic_forces(model, state, f);
  return f;
}

double potential(const MassSpringModel& model, const Forces& forces, const State& state, double load_factor) {
  double sum =
      elastic_energy(model, state) - load_factor * forces.load.cwiseProduct(displacement(model, state)).sum();
  for (const auto& energy : surface_at(forces, state, load_factor)) sum += energy->energy(state.x);
  return sum;
}

void undamped_forces(const MassSpringModel& model, const Forces& forces, const State& state,
                     Eigen::Matrix3Xd& f, double load_factor) {
  f.resizeLike(forces.load);
  for_each_chunk(f.cols(), [&](Eigen::Index begin, Eigen::Index end) {
    f.middleCols(begin, end - begin) = load_factor * forces.load.middleCols(begin, end - begin);
  });
  add_elastic_forces(model, state, f);
  for (const auto& energy : surface_at(forces, state, load_factor)) energy->add_forces(state.x, f);
}

SurfaceHessian surface_hessian(const Forces& forces, const State& state, Curvature curvature,
                               double load_factor) {
  SurfaceHessian H;
  for (const auto& energy : surface_at(forces, state, load_factor))
    energy->add_hessian(state.x, H, curvature);
  return H;
}

namespace {

/// Pairs of nodes that an energy couples, 2 x m; those of several energies repeat.
Eigen::Matrix2Xi coupled_pairs(const MassSpringModel& model) {
  std::vector<Eigen::Matrix2Xi> lists;
  for_each_energy(model, [&](const auto& energy) { lists.push_back(pairs_of(energy)); });
  Eigen::Index n_pairs = 0;
  for (const auto& list : lists) n_pairs += list.cols();
  Eigen::Matrix2Xi pairs(2, n_pairs);
  n_pairs = 0;
  for (const auto& list : lists) {
    pairs.middleCols(n_pairs, list.cols()) = list;
    n_pairs += list.cols();
  }
  return pairs;
}

}  // namespace

BlockMatrix stiffness_pattern(const MassSpringModel& model) {
  return make_block_matrix(static_cast<int>(model.network.X.cols()), coupled_pairs(model));
}

void add_stiffness(const MassSpringModel& model, const State& state, BlockMatrix& K, Curvature curvature) {
  if (model.linear) {
    const State rest = initial_state(model);
    for_each_energy(model,
                    [&](const auto& energy) { add_hessian_at(model, rest, energy, K, Curvature::Exact); });
    mirror(K);
    K.kept = std::vector<int>();  // it is assembled once
    K.kept_of = 0;
    return;
  }
  for_each_energy(model, [&](const auto& energy) { add_hessian_at(model, state, energy, K, curvature); });
  mirror(K);
}

BlockMatrix simple_stiffness(const MassSpringModel& model, const State& state) {
  if (!model.tet_springs) {
    BlockMatrix K = stiffness_pattern(model);
    add_stiffness(model, state, K);
    return K;
  }
  const auto& [X, T, F, n_surface] = model.network;
  const bool is_simple = model.tet_springs->n_patches() == T.cols();
  const Eigen::RowVectorXd parts =
      is_simple ? Eigen::RowVectorXd::Ones(T.cols()).eval() : parts_left_by_averages(X, T);
  if (model.linear) return stiffness_of_tetrahedra(X, T, lame_of(model.material), parts);
  const TetSprings simple = single_tetrahedra(X, T, lame_of(model.material), parts);
  BlockMatrix K = make_block_matrix(static_cast<int>(state.x.cols()), pairs_of(simple));
  add_hessian(simple, displacement(model, state), K);
  mirror(K);
  K.kept = std::vector<int>();  // it is assembled once
  K.kept_of = 0;
  return K;
}

Eigen::Index n_stiffness_blocks(const MassSpringModel& model) {
  const Eigen::Matrix2Xi pairs = coupled_pairs(model);
  std::vector<std::pair<int, int>> once(pairs.cols());
  for (Eigen::Index s = 0; s < pairs.cols(); ++s) once[s] = std::minmax(pairs(0, s), pairs(1, s));
  std::sort(once.begin(), once.end());
  once.erase(std::unique(once.begin(), once.end()), once.end());
  return model.network.X.cols() + 2 * static_cast<Eigen::Index>(once.size());
}

double smallest_jacobian(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T, const Eigen::Matrix3Xd& u) {
  const Eigen::Matrix3Xd x = X + u;
  double smallest = std::numeric_limits<double>::infinity();
  for (const auto& t : T.colwise()) smallest = std::min(smallest, tet_volume(x, t) / tet_volume(X, t));
  return smallest;
}

double largest_strain(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T, const Eigen::Matrix3Xd& u) {
  double largest = 0;
  for (const auto& t : T.colwise()) {
    Eigen::Matrix3d rest, moved;
    for (int k = 0; k < 3; ++k) {
      rest.col(k) = X.col(t[k + 1]) - X.col(t[0]);
      moved.col(k) = u.col(t[k + 1]) - u.col(t[0]);
    }
    const Eigen::Matrix3d H = moved * rest.inverse(), C_1 = H + H.transpose() + H.transpose() * H;
    // |s - 1| <= |s^2 - 1| of a stretch s: most tetrahedra need no eigenvalues.
    if (C_1.norm() <= largest) continue;
    const Eigen::Array3d squares_1 =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(C_1, Eigen::EigenvaluesOnly)
            .eigenvalues()
            .array()
            .max(-1);
    largest = std::max(largest, (squares_1 / (1 + (1 + squares_1).sqrt())).abs().maxCoeff());
  }
  return largest;
}

double largest_strain(const Springs& springs, const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xd& x) {
  double largest = 0;
  for (const auto& s : springs.E.colwise())
    largest = std::max(largest,
                       std::abs((x.col(s(0)) - x.col(s(1))).norm() / (X.col(s(0)) - X.col(s(1))).norm() - 1));
  return largest;
}

bool is_springs_alone(const MassSpringModel& model) {
  return model.springs && n_energies(model) == 1 && !model.linear;
}

void filter(const std::vector<Constraint>& constraints, Eigen::Matrix3Xd& y) {
  for (const Constraint& c : constraints) y.col(c.node) = (c.S * y.col(c.node)).eval();
}

void filter(const std::vector<Constraint>& constraints, BlockMatrix& A) {
  double d = 0;
  for (int i = 0; i < A.rows(); ++i) d = std::max(d, A.block[A.diagonal[i]].diagonal().maxCoeff());
  for (const Constraint& c : constraints) {
    for (int k = A.row_start[c.node]; k < A.row_start[c.node + 1]; ++k) {
      A.block[k] = c.S * A.block[k];
      Eigen::Matrix3d& transposed = A.block[A.find(A.column[k], c.node)];
      transposed = transposed * c.S;
    }
    A.block[A.diagonal[c.node]] += d * (Eigen::Matrix3d::Identity() - c.S);
  }
}

Eigen::Vector3d prescribed(const Constraint& c, double t, double end) {
  Eigen::Vector3d u = t / end * c.displacement;
  for (int k = 0; k < 3; ++k)
    if (c.motion[k]) u(k) = position_at(*c.motion[k], t)(k);
  return u - c.S * u;
}

void prescribe(const std::vector<Constraint>& constraints, const Eigen::Matrix3Xd& rest, double t, double end,
               Eigen::Matrix3Xd& x) {
  for (const Constraint& c : constraints)
    x.col(c.node) =
        c.S * x.col(c.node) + (Eigen::Matrix3d::Identity() - c.S) * rest.col(c.node) + prescribed(c, t, end);
}

}  // namespace testbed::massspring
