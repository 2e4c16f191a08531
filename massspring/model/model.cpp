#include "massspring/model/model.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <map>
#include <stdexcept>

#include "massspring/energies/tractions.h"
#include "massspring/kernels/parts.h"
#include "meshing/surface/surface.h"

namespace testbed::massspring {
State initial_state(const MassSpringModel& model) {
  State state;
  state.x = model.network.X;
  state.v = Eigen::Matrix3Xd::Zero(3, state.x.cols());
  state.target_volume = volume(state.x, model.network.F);
  const auto& E = model.network.E;
  state.rest_length.resize(E.cols());
  for (int s = 0; s < E.cols(); ++s)
    state.rest_length(s) = (state.x.col(E(0, s)) - state.x.col(E(1, s))).norm();
  return state;
}

Forces forces_of(const Scene& scene, const MassSpringModel& model) {
  const SpringNetwork& network = model.network;
  const SurfaceMesh surface{network.X.leftCols(network.n_surface), network.F};
  Forces forces;
  forces.mass_damping = scene.material.damping;
  if (scene.volume && scene.volume->coefficient > 0) forces.volume_pressure = scene.volume->coefficient;
  forces.load = Eigen::Matrix3Xd::Zero(3, network.X.cols());
  if (scene.gravity) forces.load += *scene.gravity * model.mass.transpose();

  const Eigen::Matrix3Xd areas = area_vectors(surface.X, surface.F);
  for (size_t l = 0; l < scene.loads.size(); ++l) {
    const Load& load = scene.loads[l];
    const std::vector<int> triangles = triangles_in(load.region, surface);
    if (triangles.empty())
      throw std::runtime_error("loads." + std::to_string(l) +
                               ": no triangle of the surface lies in its region");
    if (load.is_follower) {
      FollowerPressure follower{load.pressure, Eigen::Matrix3Xi(3, triangles.size())};
      for (size_t i = 0; i < triangles.size(); ++i) follower.F.col(i) = surface.F.col(triangles[i]);
      if (!is_closed(follower.F))
        throw std::runtime_error(
            "loads." + std::to_string(l) +
            ".follower = true, expected a region that holds whole components of the surface");
      forces.followers.push_back(std::move(follower));
    }
    if (!load.stress.empty())
      forces.load.leftCols(network.n_surface) +=
          traction_forces([&load](const Eigen::Vector3d& x) { return stress_at(load.stress, x); }, surface.X,
                          surface.F(Eigen::all, triangles));
    const double dead_pressure = load.is_follower ? 0 : load.pressure;
    for (int f : triangles) {
      const Eigen::Vector3d third = (areas.col(f).norm() * load.traction - dead_pressure * areas.col(f)) / 3;
      for (int i : surface.F.col(f)) forces.load.col(i) += third;
    }
  }

  std::map<int, Constraint> of_node;
  for (size_t s = 0; s < scene.supports.size(); ++s) {
    const Support& support = scene.supports[s];
    const std::vector<int> nodes = vertices_in(support.region, surface);
    const auto motion = support.motion.empty() ? nullptr : std::make_shared<const Path>(support.motion);
    if (nodes.empty())
      throw std::runtime_error("supports." + std::to_string(s) +
                               ": no node of the surface lies in its region");
    for (int i : nodes) {
      Constraint& c =
          of_node.try_emplace(i, Constraint{i, Eigen::Matrix3d::Identity(), Eigen::Vector3d::Zero()})
              .first->second;
      for (int k = 0; k < 3; ++k)
        if (support.fixed[k]) {
          c.S(k, k) = 0;
          c.displacement(k) = support.displacement(k);
          c.motion[k] = motion;
        }
    }
  }
  for (const auto& [node, constraint] : of_node) forces.constraints.push_back(constraint);
  return forces;
}

void add_skin(const Skin& skin, MassSpringModel& model) {
  const auto& [X, F, E, T, n_surface] = model.network;
  if (skin.stiffness > 0) {
    const Eigen::Index n_edges = F.cols() * 3 / 2;  // of the surface, which come first
    if (!model.springs) model.springs = Springs{E.leftCols(n_edges), Eigen::VectorXd::Zero(n_edges)};
    std::map<std::pair<int, int>, double> areas;
    for (const auto& t : F.colwise()) {
      const double area = (X.col(t(1)) - X.col(t(0))).cross(X.col(t(2)) - X.col(t(0))).norm() / 2;
      for (int k = 0; k < 3; ++k) areas[std::minmax(t(k), t((k + 1) % 3))] += area;
    }
    Springs& springs = *model.springs;
    for (Eigen::Index s = 0; s < n_edges; ++s) {
      const int a = springs.E(0, s), b = springs.E(1, s);
      springs.stiffness(s) +=
          skin.stiffness * areas.at(std::minmax(a, b)) / (X.col(a) - X.col(b)).squaredNorm();
    }
  }
  if (skin.bending > 0) model.bending = make_bending(X, F, skin.bending);
}

void add_momenta(const MassSpringModel& model, double factor, const Eigen::Matrix3Xd& v,
                 Eigen::Matrix3Xd& p) {
  for_each_chunk(v.cols(), [&](Eigen::Index begin, Eigen::Index end) {
    const Eigen::Index m = end - begin;
    p.middleCols(begin, m) += factor * v.middleCols(begin, m) * model.mass.segment(begin, m).asDiagonal();
  });
  if (model.spread_mass) add_product(*model.spread_mass, -factor, v, p);
}

Eigen::Matrix3Xd momenta(const MassSpringModel& model, const Eigen::Matrix3Xd& v) {
  Eigen::Matrix3Xd p = Eigen::Matrix3Xd::Zero(3, v.cols());
  add_momenta(model, 1, v, p);
  return p;
}

double kinetic_energy(const MassSpringModel& model, const Eigen::Matrix3Xd& v) {
  return v.cwiseProduct(momenta(model, v)).sum() / 2;
}

double elastic_energy(const MassSpringModel& model, const State& state) {
  double sum = 0;
  if (model.springs) sum += energy(*model.springs, state.rest_length, state.x);
  if (model.tet_springs) sum += energy(*model.tet_springs, state.x, state.patch_scale);
  if (model.bending) sum += energy(*model.bending, state.x);
  if (model.local_volume) sum += energy(*model.local_volume, state.x);
  return sum;
}

namespace {

void add_elastic_forces(const MassSpringModel& model, const State& state, Eigen::Matrix3Xd& f) {
  if (model.springs) add_forces(*model.springs, state.rest_length, state.x, f);
  if (model.tet_springs) add_forces(*model.tet_springs, state.x, f, state.patch_scale);
  if (model.bending) add_forces(*model.bending, state.x, f);
  if (model.local_volume) add_forces(*model.local_volume, state.x, f);
}

}  // namespace

Eigen::Matrix3Xd elastic_forces(const MassSpringModel& model, const State& state) {
  Eigen::Matrix3Xd f = Eigen::Matrix3Xd::Zero(3, state.x.cols());
  add_elastic_forces(model, state, f);
  return f;
}

double potential(const MassSpringModel& model, const Forces& forces, const State& state, double load_factor) {
  double sum =
      elastic_energy(model, state) - load_factor * forces.load.cwiseProduct(state.x - model.network.X).sum();
  for (const FollowerPressure& follower : forces.followers)
    sum += load_factor * follower.pressure * volume(state.x, follower.F);
  if (forces.volume_pressure)
    sum += volume_energy(*forces.volume_pressure, state.target_volume, model.network.F, state.x);
  return sum;
}

void undamped_forces(const MassSpringModel& model, const Forces& forces, const State& state,
                     Eigen::Matrix3Xd& f, double load_factor) {
  f.resizeLike(forces.load);
  for_each_chunk(f.cols(), [&](Eigen::Index begin, Eigen::Index end) {
    f.middleCols(begin, end - begin) = load_factor * forces.load.middleCols(begin, end - begin);
  });
  add_elastic_forces(model, state, f);
  for (const FollowerPressure& follower : forces.followers) {
    Eigen::Matrix3Xd gradient;
    volume_and_gradient(follower.F, state.x, gradient);
    f.leftCols(gradient.cols()) -= load_factor * follower.pressure * gradient;
  }
  if (forces.volume_pressure)
    add_volume_forces(*forces.volume_pressure, state.target_volume, model.network.F, state.x, f);
}

std::optional<Eigen::Matrix3Xd> volume_stiffness_root(const MassSpringModel& model, const Forces& forces,
                                                      const State& state) {
  if (!forces.volume_pressure) return {};
  return volume_stiffness_root(*forces.volume_pressure, state.target_volume, model.network.F, state.x);
}

std::vector<VolumeCurvature> volume_curvatures(const MassSpringModel& model, const Forces& forces,
                                               const State& state, double load_factor) {
  std::vector<VolumeCurvature> curvatures;
  const Eigen::Matrix3Xi& F = model.network.F;
  if (forces.volume_pressure)
    curvatures.push_back({*forces.volume_pressure * (volume(state.x, F) / state.target_volume - 1), &F});
  for (const FollowerPressure& f : forces.followers) curvatures.push_back({load_factor * f.pressure, &f.F});
  return curvatures;
}

BlockMatrix stiffness_pattern(const MassSpringModel& model) {
  std::vector<Eigen::Matrix2Xi> parts;
  if (model.springs) parts.push_back(model.springs->E);
  if (model.tet_springs) parts.push_back(pairs_of(*model.tet_springs));
  if (model.bending) parts.push_back(pairs_of(*model.bending));
  if (model.local_volume) parts.push_back(pairs_of(*model.local_volume));
  Eigen::Index n_pairs = 0;
  for (const auto& part : parts) n_pairs += part.cols();
  Eigen::Matrix2Xi pairs(2, n_pairs);
  n_pairs = 0;
  for (const auto& part : parts) {
    pairs.middleCols(n_pairs, part.cols()) = part;
    n_pairs += part.cols();
  }
  return make_block_matrix(static_cast<int>(model.network.X.cols()), pairs);
}

void add_stiffness(const MassSpringModel& model, const State& state, BlockMatrix& K, Curvature curvature) {
  if (model.springs)
    add_blocks(*model.springs, hessian(*model.springs, state.rest_length, state.x, 1, curvature), K);
  if (model.tet_springs) add_hessian(*model.tet_springs, state.x, K, curvature, state.patch_scale);
  if (model.bending) add_hessian(*model.bending, state.x, K);
  if (model.local_volume) add_hessian(*model.local_volume, state.x, K);
}

bool is_springs_alone(const MassSpringModel& model) {
  return model.springs && !model.tet_springs && !model.bending && !model.local_volume;
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
