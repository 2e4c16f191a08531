#include "massspring/model.h"

#include <Eigen/Geometry>
#include <map>
#include <stdexcept>

#include "meshing/surface.h"

namespace testbed {

const char* name_of(Status status) {
  return status == Status::Ok ? "ok" : status == Status::Diverged ? "diverged" : "not_converged";
}

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
  forces.load = Eigen::Matrix3Xd::Zero(3, network.X.cols());
  if (scene.gravity) forces.load += *scene.gravity * model.mass.transpose();

  const Eigen::Matrix3Xd areas = area_vectors(surface.X, surface.F);
  for (size_t l = 0; l < scene.loads.size(); ++l) {
    const Load& load = scene.loads[l];
    const std::vector<int> triangles = triangles_in(load.region, surface);
    if (triangles.empty())
      throw std::runtime_error("loads." + std::to_string(l) +
                               ": no triangle of the surface lies in its region");
    for (int f : triangles) {
      const Eigen::Vector3d third = (areas.col(f).norm() * load.traction - load.pressure * areas.col(f)) / 3;
      for (int i : surface.F.col(f)) forces.load.col(i) += third;
    }
  }

  std::map<int, Constraint> of_node;
  for (size_t s = 0; s < scene.supports.size(); ++s) {
    const Support& support = scene.supports[s];
    const std::vector<int> nodes = vertices_in(support.region, surface);
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
        }
    }
  }
  for (const auto& [node, constraint] : of_node) forces.constraints.push_back(constraint);
  return forces;
}

double elastic_energy(const MassSpringModel& model, const State& state) {
  double sum = 0;
  if (model.springs) sum += energy(*model.springs, state.rest_length, state.x);
  if (model.tet_springs) sum += energy(*model.tet_springs, state.x);
  return sum;
}

Eigen::Matrix3Xd elastic_forces(const MassSpringModel& model, const State& state) {
  Eigen::Matrix3Xd f = Eigen::Matrix3Xd::Zero(3, state.x.cols());
  if (model.springs) add_forces(*model.springs, state.rest_length, state.x, f);
  if (model.tet_springs) add_forces(*model.tet_springs, state.x, f);
  return f;
}

BlockMatrix stiffness_pattern(const MassSpringModel& model) {
  Eigen::Matrix2Xi pairs = model.tet_springs ? pairs_of(*model.tet_springs) : Eigen::Matrix2Xi(2, 0);
  if (model.springs) {
    pairs.conservativeResize(2, pairs.cols() + model.springs->E.cols());
    pairs.rightCols(model.springs->E.cols()) = model.springs->E;
  }
  return make_block_matrix(static_cast<int>(model.network.X.cols()), pairs);
}

void add_stiffness(const MassSpringModel& model, const State& state, BlockMatrix& K, Curvature curvature) {
  if (model.springs)
    add_blocks(*model.springs, hessian(*model.springs, state.rest_length, state.x, 1, curvature), K);
  if (model.tet_springs) add_hessian(*model.tet_springs, state.x, K, curvature);
}

bool is_springs_alone(const MassSpringModel& model) {
  return model.springs && !model.tet_springs;
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

void prescribe(const std::vector<Constraint>& constraints, const Eigen::Matrix3Xd& rest, double fraction,
               Eigen::Matrix3Xd& x) {
  for (const Constraint& c : constraints)
    x.col(c.node) = c.S * x.col(c.node) +
                    (Eigen::Matrix3d::Identity() - c.S) * (rest.col(c.node) + fraction * c.displacement);
}

}  // namespace testbed
