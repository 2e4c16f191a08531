// What the elastic solid is made of. Internal to the library: it brings deal.II's headers.
#pragma once

#include <deal.II/base/quadrature_lib.h>

#include <optional>
#include <vector>

#include "fem_reference/elements/enclosed_volume.h"
#include "fem_reference/solid/elasticity.h"
#include "fem_reference/solvers/two_level.h"

namespace testbed::fem {

struct ElasticSolid::Implementation {
  Implementation(const TetMesh& tets, int p)
      : mesh(tets),
        degree(p),
        nodes(mesh, degree),
        space(triangulate(mesh, triangulation), degree, nodes),
        u(Eigen::Matrix3Xd::Zero(3, nodes.X.cols())) {
    if (degree == 2 && processes().n == 1) {
      coarse_space.emplace(triangulation, 1, nodes);
      coarse.emplace(*coarse_space);
    }
    solver.emplace(nodes, space, coarse_space ? &*coarse_space : nullptr);
  }

  TetMesh mesh;
  int degree;
  Nodes nodes;
  dealii::Triangulation<3> triangulation;
  dealii::MappingFE<3> mapping{dealii::FE_SimplexP<3>(1)};
  Space space;
  std::optional<Space> coarse_space;  // of degree 1
  std::optional<TwoLevelSolver> solver;
  SystemMatrix fine{space};
  std::optional<SystemMatrix> coarse;  // of degree 1

  Material material;
  ElasticLaw law = ElasticLaw::SmallStrain;
  double tolerance = 1e-13;
  ElasticLoads loads;
  std::vector<HeldComponent> held;
  Eigen::VectorXd load;  // N at full load, of component c of node i at 3 i + c
  Eigen::MatrixXd
      rigid;  // free rigid motions of the body as deformed, over the degrees of freedom, orthonormal

  Eigen::Matrix3Xd u;
  double factor = 0;  // load factor of u

  ElasticReport find_equilibrium(double load_factor, StageTimer* timer);
  void find_rigid_motions(const Eigen::Matrix3Xd& at);
  void check_balance() const;
  double held_displacement(int k, double load_factor) const;
  void find_load();
  /// Parts of the tangent that are wanted.
  struct Tangent {
    bool of_body, of_pressure;
  };
  /// Calls use(ranks, tangent, forces against the displacement, elastic energy) for every cell, then for
  /// every boundary triangle under a follower pressure; arguments as of SystemMatrix::add_cell.
  template <class Use>
  void for_each_element(const Space& on, const Eigen::Matrix3Xd& at, double load_factor,
                        const Tangent& tangent, Use use) const;
  Eigen::VectorXd assemble_tangent(const Space& on, SystemMatrix& into, const Eigen::Matrix3Xd& at,
                                   double load_factor, const Tangent& tangent = {true, true}) const;
  /// Calls use(follower pressure at a load factor, nodes, their EnclosedVolume at `at`) for every boundary
  /// triangle of 3 or 6 nodes that has one.
  template <class Use>
  void for_each_follower(Eigen::Index n_nodes, const Eigen::Matrix3Xd& at, double load_factor,
                         Use use) const {
    for (int f = 0; loads.follower_pressure && f < nodes.faces.cols(); ++f) {
      const double p = load_factor * loads.follower_pressure(f);
      const Eigen::VectorXi face = nodes.faces.col(f).head(n_nodes);
      if (p != 0) use(p, face, enclosed_volume(nodes.X(Eigen::all, face) + at(Eigen::all, face)));
    }
  }
  void remove_rigid_motion(Eigen::Matrix3Xd& displacement) const;
  void measure(const Eigen::Matrix3Xd& at, double load_factor, ElasticReport& report,
               bool with_strain = true) const;
  double potential(const Eigen::Matrix3Xd& at, double load_factor) const;
  /// Exact for the stiffness of degree p at small strain and no eigenstrain that varies.
  dealii::Quadrature<3> quadrature(int p) const;
};

}  // namespace testbed::fem
