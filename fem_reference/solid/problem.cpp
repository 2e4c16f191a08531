#include "fem_reference/solid/problem.h"

#include <Eigen/Geometry>
#include <set>
#include <stdexcept>

#include "fem_reference/elements/refine.h"
#include "fem_reference/solid/divided.h"
#include "fem_reference/solid/schemes.h"
#include "meshing/algebra/rigid_motion.h"
#include "meshing/scene/collapse.h"
#include "meshing/scene/surface_problem.h"
#include "meshing/surface/surface.h"
#include "meshing/surface_energies/barrier.h"
#include "meshing/surface_energies/handles.h"
#include "meshing/surface_energies/membrane.h"
#include "meshing/surface_energies/proximal_term.h"
#include "meshing/surface_energies/seams.h"
#include "meshing/surface_energies/self_barrier.h"
#include "meshing/surface_energies/surface_points.h"
#include "meshing/surface_energies/volume_penalty.h"

namespace testbed::fem {
namespace {

/// Children of triangle f of the surface are the mesh's boundary triangles n f ... n f + n - 1.
ElasticLoads loads_of(const Scene& scene, const SurfaceMesh& surface, const SurfaceProblem& problem,
                      int n_children) {
  ElasticLoads loads;
  if (const auto gravity = gravity_of(scene))
    loads.body_force = [f = Eigen::Vector3d(scene.material.rho * *gravity)](const Eigen::Vector3d&) {
      return f;
    };
  if (!scene.loads.empty()) {
    const Eigen::Matrix3Xd normals = area_vectors(surface.X, surface.F).colwise().normalized();
    if (!problem.follower_pressure.isZero(0))
      loads.follower_pressure = [n_children, follower = problem.follower_pressure](int f) {
        return follower(f / n_children);
      };
    std::vector<std::vector<StressTerm>> stress(surface.F.cols());
    for (const auto& [triangles, terms] : problem.stressed)
      for (const int f : triangles) stress[f].insert(stress[f].end(), terms.begin(), terms.end());
    loads.traction = [=, traction = problem.traction](const Eigen::Vector3d& x,
                                                      int child) -> Eigen::Vector3d {
      const int f = child / n_children;
      return traction.col(f) + stress_at(stress[f], x) * normals.col(f);
    };
  }
  if (scene.collapse && scene.time.mode == TimeMode::Static)
    loads.shrinkage = [collapse = *scene.collapse, side = shortest_side(surface),
                       part_at = collapsing_part(*scene.collapse, surface)](const Eigen::Vector3d& x,
                                                                            double load_factor) {
      return 1 - static_length(collapse, side, part_at(x), x, load_factor);
    };
  return loads;
}

/// The loads on the body as its frame's axes see it.
ElasticLoads seen_from(const Eigen::Matrix3d& frame, const ElasticLoads& loads) {
  using Eigen::Vector3d;
  ElasticLoads seen = loads;
  if (loads.body_force)
    seen.body_force = [=, force = loads.body_force](const Vector3d& x) -> Vector3d {
      return frame.transpose() * force(frame * x);
    };
  if (loads.traction)
    seen.traction = [=, traction = loads.traction](const Vector3d& x, int f) -> Vector3d {
      return frame.transpose() * traction(frame * x, f);
    };
  if (loads.shrinkage)
    seen.shrinkage = [=, shrinkage = loads.shrinkage](const Vector3d& x, double load_factor) {
      return shrinkage(frame * x, load_factor);
    };
  return seen;
}

/// Supports go into the loads where they move in time, and into `constrained`, those of a share alone.
/// @param boundaries  boundary triangles with the middles of their edges (6 nodes), from the coarsest mesh to
/// the finest
std::vector<ConstrainedComponent> constrained_by(const Scene& scene, const SurfaceProblem& problem,
                                                 const std::vector<Eigen::MatrixXi>& boundaries,
                                                 const Eigen::Matrix3d& frame, const Share& share,
                                                 ElasticLoads& loads) {
  constexpr double kHalf = 0.5;  // between the parts of an axis that are constrained, all of it or none
  std::vector<ConstrainedComponent> constrained;
  const std::unordered_map<int, int> local = share.local();
  for (size_t s = 0; s < problem.constrained.size(); ++s) {
    const auto& [vertices, support] = problem.constrained[s];
    Eigen::Vector3d part = Eigen::Vector3d::Zero();  // of each axis
    for (const Eigen::Vector3d& direction : constrained_directions(support))
      part += (frame.transpose() * direction).cwiseAbs2();
    std::set<int> nodes(vertices.begin(), vertices.end());
    for (const Eigen::MatrixXi& faces : boundaries)
      for (const auto& face : faces.colwise())
        for (int e = 0; e < 3; ++e)
          if (nodes.count(face(e)) && nodes.count(face((e + 1) % 3))) nodes.insert(face(3 + e));
    for (int node : nodes) {
      const auto here = local.find(node);
      if (!share.is_whole && here == local.end()) continue;
      for (int c = 0; c < 3; ++c)
        if (part(c) > kHalf)
          constrained.push_back({share.is_whole ? node : here->second, c,
                                 frame.col(c).dot(support.displacement), static_cast<int>(s)});
    }
  }
  loads.motion = [supports = scene.supports, time = scene.time, frame, constrained](int k, double t) {
    return frame.col(constrained[k].component)
        .dot(displacement_at(supports[constrained[k].support], time, t));
  };
  return constrained;
}

std::vector<meshing::RigidBody> rigid_bodies(const Scene& scene, const Eigen::Matrix3d& frame) {
  std::vector<meshing::RigidBody> bodies;
  for (const Obstacle& obstacle : scene.obstacles) bodies.emplace_back(obstacle, frame);
  return bodies;
}

/// Per node of n, whether supports hold all of it and never end.
std::vector<char> held_nodes(const Scene& scene, const std::vector<ConstrainedComponent>& constrained,
                             Eigen::Index n) {
  std::vector<std::set<int>> components(n);
  for (const ConstrainedComponent& h : constrained)
    if (!scene.supports[h.support].end) components[h.node].insert(h.component);
  std::vector<char> is_constrained(components.size());
  for (size_t i = 0; i < components.size(); ++i) is_constrained[i] = components[i].size() == 3;
  return is_constrained;
}

/// Of several processes, as obstacles_in_statics or in motion.
meshing::SurfaceEnergies divided_obstacles(const std::vector<meshing::RigidBody>& bodies,
                                           const ElasticSolid& solid, double E,
                                           const std::vector<char>& is_constrained, bool is_static) {
  const Share& share = solid.share();
  const Eigen::Matrix3Xd& X = solid.X();
  const double size = diagonal_over_processes(X);
  const auto barrier = [&](const meshing::IsCounted& is_counted) {
    return barrier_around(bodies, X, solid.faces(), E, is_constrained,
                          is_static ? meshing::FrictionLag::Iteration : meshing::FrictionLag::Step, size,
                          is_counted);
  };
  meshing::SurfaceEnergies energies{std::make_shared<DividedSum>(
      share, barrier({}), barrier([&](const Eigen::VectorXi& nodes) { return share.counts(nodes); }))};
  if (!is_static) return energies;
  const Eigen::MatrixXd motions = share.rigid_motions(X);
  Eigen::Matrix<double, 6, 6> fixed = Eigen::Matrix<double, 6, 6>::Zero();
  std::vector<Eigen::Triplet<double>> owned;
  for (Eigen::Index i = 0; i < X.cols(); ++i) {
    if (share.is_ghost[i]) continue;
    owned.emplace_back(static_cast<int>(owned.size()), static_cast<int>(i), 1.);
    if (is_constrained[i]) fixed += motions.middleRows<3>(3 * i).transpose() * motions.middleRows<3>(3 * i);
  }
  sum_over_processes(fixed.reshaped());
  if (meshing::free_combinations(fixed).cols() == 0) return energies;
  meshing::SurfacePoints points(static_cast<Eigen::Index>(owned.size()), X.cols());
  points.setFromTriplets(owned.begin(), owned.end());
  const auto guide = [&] { return meshing::soft_proximal_term(E, size, share.n_nodes); };
  energies.push_back(std::make_shared<DividedSum>(
      share, guide(), std::make_shared<meshing::EnergyOfPoints>(guide(), points)));
  return energies;
}

/// What scene.obstacles do to the surface of a body, whose coordinates are those of the frame's axes.
meshing::SurfaceEnergies obstacles_of(const Scene& scene, const ElasticSolid& solid,
                                      const std::vector<ConstrainedComponent>& constrained,
                                      const Eigen::Matrix3d& frame) {
  if (scene.obstacles.empty()) return {};
  const std::vector<meshing::RigidBody> bodies = rigid_bodies(scene, frame);
  const std::vector<char> is_constrained = held_nodes(scene, constrained, solid.X().cols());
  const double E = scene.material.E;
  const bool is_static = scene.time.mode == TimeMode::Static;
  if (!solid.share().is_whole) return divided_obstacles(bodies, solid, E, is_constrained, is_static);
  if (is_static) return obstacles_in_statics(bodies, solid.X(), solid.faces(), E, is_constrained);
  return {barrier_around(bodies, solid.X(), solid.faces(), E, is_constrained)};
}

meshing::SurfaceEnergies skin_of(const Scene& scene, const ElasticSolid& solid, const SurfaceMesh& surface,
                                 const Eigen::Matrix3d& frame) {
  const Share& share = solid.share();
  const auto part = [&](const meshing::IsCounted& is_counted, const meshing::LargestOf& largest_of) {
    return meshing::skin_of(scene, solid.X(), solid.faces(), frame, shortest_side(surface), is_counted,
                            largest_of);
  };
  if (share.is_whole) return part({}, {});
  const auto largest_of = [&share](const Eigen::VectorXd& values) {
    double largest = 0;
    for (Eigen::Index i = 0; i < values.size(); ++i)
      if (!share.is_ghost[i]) largest = std::max(largest, values(i));
    return largest_over_processes(largest);
  };
  meshing::SurfaceEnergies skin = part({}, largest_of);
  const auto counted = part([&](const Eigen::VectorXi& nodes) { return share.counts(nodes); }, largest_of);
  for (size_t k = 0; k < skin.size(); ++k) skin[k] = std::make_shared<DividedSum>(share, skin[k], counted[k]);
  return skin;
}

/// A VolumePenalty or HeldVolume.
template <class Volume>
std::shared_ptr<meshing::SurfaceEnergy> volume_energy(double P, const Scene& scene,
                                                      const ElasticSolid& solid) {
  const Share& share = solid.share();
  const meshing::Faces faces = meshing::faces_of(solid.faces());
  if (share.is_whole)
    return std::make_shared<Volume>(P, faces, target_volume_of(scene, volume_of(faces, solid.X())));
  return std::make_shared<DividedVolume<Volume>>(share, P, faces, target_volume_of(scene, share.volume));
}

/// The scene's skin, and what keeps its volume, on the surface of a body.
meshing::SurfaceEnergies bag_of(const Scene& scene, const ElasticSolid& solid, const SurfaceMesh& surface,
                                const Eigen::Matrix3d& frame) {
  meshing::SurfaceEnergies energies = skin_of(scene, solid, surface, frame);
  if (scene.volume && scene.volume->is_exact)
    energies.push_back(volume_energy<meshing::HeldVolume>(scene.material.E, scene, solid));
  else if (scene.volume && scene.volume->coefficient > 0)
    energies.push_back(volume_energy<meshing::VolumePenalty>(scene.volume->coefficient, scene, solid));
  return energies;
}

meshing::SurfaceEnergies seams_on(const SurfaceProblem& problem, const Share& share) {
  if (problem.stitches.empty()) return {};
  const auto seam = [](const SurfaceProblem& stitched) {
    return std::make_shared<meshing::PlainEnergy<meshing::Seams>>(seams_of(stitched), "seam");
  };
  if (share.is_whole) return {seam(problem)};
  const std::unordered_map<int, int> local = share.local();
  SurfaceProblem acting, counted;
  for (const auto& [a, b, stiffness] : problem.stitches) {
    const auto i = local.find(a), j = local.find(b);
    if (i == local.end() || j == local.end()) continue;
    acting.stitches.push_back({i->second, j->second, stiffness});
    if (share.counts(Eigen::Vector2i(i->second, j->second)))
      counted.stitches.push_back(acting.stitches.back());
  }
  return {std::make_shared<DividedSum>(share, seam(acting), seam(counted))};
}

/// The handles of a problem, of several processes those on this one's nodes.
meshing::SurfaceEnergies handles_of(SurfaceProblem problem, const ElasticSolid& solid,
                                    const Eigen::Matrix3d& frame) {
  const Share& share = solid.share();
  for (auto& [vertices, handle] : problem.held) {
    std::vector<int> owned = share.owned(vertices);
    handle.stiffness *= static_cast<double>(owned.size()) / static_cast<double>(vertices.size());
    vertices = std::move(owned);
  }
  meshing::SurfaceEnergies energies = meshing::handles_of(problem, solid.X(), frame);
  if (share.is_whole) return energies;
  for (auto& energy : energies) energy = std::make_shared<DividedSum>(share, energy, energy);
  return energies;
}

/// What the surface of a body, cut as given, does to itself.
meshing::SurfaceEnergies self_contact_of(const Scene& scene, const ElasticSolid& solid,
                                         const SurfaceMesh& surface) {
  if (!scene.self_contact.is_on) return {};
  const double thickness =
      scene.self_contact.thickness.value_or(meshing::default_thickness(surface.X, surface.F));
  const auto barrier = [&](const meshing::IsCounted& is_counted) {
    return std::make_shared<DividedSelfBarrier>(solid.X(), meshing::flat_triangles(solid.faces()),
                                                scene.material.E, thickness, scene.self_contact.friction,
                                                is_counted);
  };
  const Share& share = solid.share();
  if (share.is_whole) return {barrier({})};
  const auto is_here = [&share](const Eigen::VectorXi& nodes) {
    return std::any_of(nodes.begin(), nodes.end(), [&](int i) { return !share.is_ghost[i]; });
  };
  const auto is_counted = [&share](const Eigen::VectorXi& nodes) { return share.counts(nodes); };
  return {std::make_shared<DividedSum>(share, barrier(is_here), barrier(is_counted))};
}

/// A refined boundary triangle's four children hold the middles of its edges.
Eigen::MatrixXi boundary_with_middles(const TetMesh& coarse, const TetMesh& fine) {
  Eigen::MatrixXi faces(6, coarse.F.cols());
  for (int f = 0; f < coarse.F.cols(); ++f) {
    const auto middle = fine.F.col(4 * f + 3);  // of ab, bc, ca
    faces.col(f) << coarse.F.col(f), middle;
  }
  return faces;
}

}  // namespace

std::string unmodelled_part(const Scene& scene) {
  if (!frame_of(scene.supports))
    return "supports in directions neither parallel nor at right angles: the reference holds along three "
           "axes";
  if (!scene.events.empty()) return "events: the reference takes no other values on the way";
  const bool is_static = scene.time.mode == TimeMode::Static;
  if (scene.reference.inertia_relief && (!is_static || law_of(scene) != MaterialLaw::SmallStrain))
    return "reference.inertia_relief: for static scenes at small strain";
  if (is_static) return "";
  if (law_of(scene) != MaterialLaw::SmallStrain && scene.material.stiffness_damping > 0)
    return "material.stiffness_damping at finite strain: it would hold back rotations";
  const Scheme& scheme = find_scheme(scene.reference.integrator);
  if (scene.volume && scene.volume->is_exact && scheme.name != "minimising_euler")
    return "volume.exact with reference.integrator = " + scheme.name +
           ": minimising_euler alone holds a volume without making it swing";
  if (scheme.is_explicit() && scene.volume && scene.volume->coefficient > 0)
    return "volume.coefficient with reference.integrator = " + scheme.name +
           ": its stable step knows nothing of what joins the whole surface";
  if (scheme.is_explicit() && !scene.obstacles.empty())
    return "obstacles with reference.integrator = " + scheme.name +
           ": they would need shorter steps than the body";
  if (scheme.is_explicit() && !scene.handles.empty())
    return "handles with reference.integrator = " + scheme.name +
           ": its stable step knows nothing of their stiffness";
  if (scheme.is_explicit() && scene.self_contact.is_on)
    return "self_contact with reference.integrator = " + scheme.name +
           ": it would need shorter steps than the body";
  if (scheme.is_explicit() && scene.material.stiffness_damping > 0)
    return "material.stiffness_damping with reference.integrator = " + scheme.name +
           ": explicit steps would have to be shorter than it";
  return "";
}

ElasticSolid assemble_scene(const Scene& scene, const SurfaceMesh& surface, const TetMesh& mesh) {
  const Eigen::Matrix3d frame = frame_of(scene.supports).value();
  TetMesh fine = mesh;
  fine.X = frame.transpose() * mesh.X;
  std::vector<Eigen::MatrixXi> boundaries;
  int n_children = 1;
  for (int r = 0; r < scene.reference.refine; ++r, n_children *= 4) {
    TetMesh finer = refine(fine);
    boundaries.push_back(from_first_process(boundary_with_middles(fine, finer)));
    fine = std::move(finer);
  }
  const SurfaceProblem problem = discretise(scene, surface);
  const Joined joined{scene.skin && scene.skin->bending > 0, scene.self_contact.is_on, seams_of(problem).E};
  ElasticSolid solid(deal_out(std::move(fine), scene.reference.degree, joined), scene.reference.degree);
  const Share& share = solid.share();
  if (scene.reference.degree == 2) boundaries.push_back(share.is_whole ? solid.faces() : share.faces);
  ElasticLoads loads = seen_from(frame, loads_of(scene, surface, problem, n_children));
  const std::vector<ConstrainedComponent> constrained =
      constrained_by(scene, problem, boundaries, frame, share, loads);
  loads.surface = bag_of(scene, solid, surface, frame);
  for (auto& energy : seams_on(problem, share)) loads.surface.push_back(std::move(energy));
  for (auto& energy : obstacles_of(scene, solid, constrained, frame))
    loads.surface.push_back(std::move(energy));
  for (auto& energy : handles_of(problem, solid, frame)) loads.surface.push_back(std::move(energy));
  for (auto& energy : self_contact_of(scene, solid, surface)) loads.surface.push_back(std::move(energy));
  const bool is_linear = law_of(scene) == MaterialLaw::SmallStrain;
  solid.assemble(scene.material, is_linear ? ElasticLaw::SmallStrain : ElasticLaw::NeoHookean, loads,
                 constrained, scene.volume ? scene.volume->local : 0);
  if (scene.reference.inertia_relief) solid.relieve_inertia();
  solid.set_tolerance(scene.time.residual);
  return solid;
}

void check_apart(const Scene& scene, const ElasticSolid& solid) {
  meshing::check_apart(rigid_bodies(scene, frame_of(scene.supports).value()), solid.X(), solid.faces(),
                       held_nodes(scene, solid.constrained(), solid.X().cols()));
}

bool is_proportional(const Scene& scene) {
  if (law_of(scene) != MaterialLaw::SmallStrain) return false;
  for (const Support& support : scene.supports)
    if (!support.motion.empty()) return false;
  if (!scene.collapse) return true;
  const Collapse& collapse = *scene.collapse;
  if (collapse.pivots.size() != 1 || collapse.coefficient > 1 - collapse.least) return false;
  const Pivot& pivot = collapse.pivots[0];
  return pivot.start == 0 && !pivot.end && pivot.motion.empty();
}

}  // namespace testbed::fem
