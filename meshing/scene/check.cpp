#include "meshing/scene/check.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <boost/pending/disjoint_sets.hpp>
#include <sstream>
#include <stdexcept>

#include "meshing/scene/scene_keys.h"
#include "meshing/surface/shells.h"
#include "meshing/surface/surface_check.h"

namespace testbed::meshing {
namespace {

/// File and line of a key, or the file alone of one that was not given.
std::string place_of(const Scene& scene, const std::string& key, const std::string& file) {
  const auto found = scene.places.find(key);
  return (found == scene.places.end() ? file : found->second) + ": ";
}

/// A path along which something leaves its place.
bool moves(const Path& path) {
  return std::any_of(path.begin(), path.end(), [](const auto& point) { return !point.tail(3).isZero(0); });
}

bool is_prescribed(const Scene& scene) {
  return std::any_of(scene.supports.begin(), scene.supports.end(), [](const Support& support) {
    return !support.displacement.isZero(0) || moves(support.motion);
  });
}

bool has_load(const Scene& scene) {
  if (scene.gravity && !scene.gravity->isZero(0)) return true;
  return std::any_of(scene.loads.begin(), scene.loads.end(), [](const Load& load) {
    return load.pressure != 0 || !load.traction.isZero(0) ||
           std::any_of(load.stress.begin(), load.stress.end(),
                       [](const StressTerm& term) { return !term.tail<6>().isZero(0); });
  });
}

/// Whether anything may move the body: contacts may overlap it at rest, and a skin that relaxes moves by itself.
bool is_driven(const Scene& scene) {
  const bool starts = std::any_of(
      scene.initial.begin(), scene.initial.end(),
      [](const InitialMotion& initial) { return !initial.velocity.isZero(0) || !initial.spin.isZero(0); });
  const bool collapses = scene.collapse && scene.collapse->coefficient > 0 && !scene.collapse->pivots.empty();
  const bool swells = scene.volume &&
                      (scene.volume->coefficient > 0 || scene.volume->local > 0 || scene.volume->is_exact) &&
                      std::any_of(scene.volume->target.begin(), scene.volume->target.end(),
                                  [](const auto& point) { return point(1) != 1; });
  return has_load(scene) || is_prescribed(scene) || starts || collapses || swells || !scene.seams.empty() ||
         !scene.obstacles.empty() || !scene.handles.empty() || !scene.events.empty() ||
         scene.self_contact.is_on || (scene.skin && scene.skin->relaxation > 0);
}

/// Whether supports without end hold every vertex of the surface in all directions.
bool is_constrained_everywhere(const Scene& scene, const SurfaceMesh& surface) {
  std::vector<Eigen::Matrix3d> constrained(surface.X.cols(), Eigen::Matrix3d::Zero());
  for (const Support& support : scene.supports) {
    if (support.end) continue;
    Eigen::Matrix3d projection = Eigen::Matrix3d::Zero();
    for (const Eigen::Vector3d& direction : constrained_directions(support))
      projection += direction * direction.transpose();
    for (const int v : vertices_in(support.region, surface)) constrained[v] += projection;
  }
  constexpr double kLeast = 1e-9;  // of what holds a direction: the square of its sine against the others
  return std::all_of(constrained.begin(), constrained.end(), [](const Eigen::Matrix3d& h) {
    return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(h, Eigen::EigenvaluesOnly).eigenvalues()(0) >
           kLeast;
  });
}

std::string box_text(const Eigen::Matrix3Xd& X) {
  std::ostringstream text;
  text << "from " << X.rowwise().minCoeff().transpose() << " to " << X.rowwise().maxCoeff().transpose();
  return text.str();
}

/// Vertices of each part that neither triangles nor stitches join to others, the walls of its cavities among them.
std::vector<std::vector<int>> parts_of(const SurfaceMesh& surface,
                                       const std::vector<SurfaceProblem::Stitch>& stitches) {
  const std::vector<Shell> shells = shells_of(surface);
  std::vector<size_t> shell_of(surface.X.cols());
  boost::disjoint_sets_with_storage<> joined(shells.size());
  for (size_t s = 0; s < shells.size(); ++s) {
    for (const int f : shells[s].triangles)
      for (const int v : surface.F.col(f)) shell_of[v] = s;
    const bool is_cavity = shells[s].depth % 2 == 1;
    if (is_cavity) joined.union_set(s, static_cast<size_t>(shells[s].parent));
  }
  for (const auto& [a, b, stiffness] : stitches) joined.union_set(shell_of[a], shell_of[b]);
  std::vector<std::vector<int>> parts(shells.size());
  for (Eigen::Index v = 0; v < surface.X.cols(); ++v)
    parts[joined.find_set(shell_of[v])].push_back(static_cast<int>(v));
  parts.erase(std::remove_if(parts.begin(), parts.end(), [](const auto& part) { return part.empty(); }),
              parts.end());
  return parts;
}

}  // namespace

void check_supports(const Scene& scene, const SurfaceMesh& surface, const SurfaceProblem& problem,
                    const std::string& file) {
  const bool is_static = scene.time.mode == TimeMode::Static;
  if (!is_static || !scene.obstacles.empty() || !scene.handles.empty()) return;
  const std::vector<std::vector<int>> parts = parts_of(surface, problem.stitches);
  // One body may be free: its rigid motions are known, and reference.inertia_relief balances them.
  if (problem.constrained.empty() && parts.size() == 1) return;
  std::vector<bool> is_constrained(surface.X.cols(), false);
  for (const auto& [vertices, support] : problem.constrained)
    for (const int v : vertices) is_constrained[v] = true;
  std::vector<int> loose;
  for (size_t p = 0; p < parts.size(); ++p)
    if (std::none_of(parts[p].begin(), parts[p].end(), [&](int v) { return is_constrained[v]; }))
      loose.push_back(static_cast<int>(p));
  if (loose.empty()) return;
  throw std::runtime_error(place_of(scene, "supports", file) + std::to_string(loose.size()) +
                           " of the surface's " + std::to_string(parts.size()) +
                           " parts meet no support, first the one " +
                           box_text(surface.X(Eigen::all, parts[loose[0]])) +
                           "; expected a support for each in statics, or seams that tie it to others");
}

void check_motion(const Scene& scene, const SurfaceMesh& surface, const std::string& file) {
  if (!is_driven(scene)) {
    const std::array<std::string, 4> keys{"gravity", "loads", "supports", "surface"};
    const auto* const given = std::find_if(
        keys.begin(), keys.end(), [&](const std::string& key) { return scene.places.count(key) > 0; });
    throw std::runtime_error(
        place_of(scene, given == keys.end() ? "" : *given, file) +
        "nothing moves the body, expected gravity, a load, a prescribed displacement, an "
        "initial motion, a collapse or a volume target, and other than zero");
  }
  if (!is_prescribed(scene) && is_constrained_everywhere(scene, surface) &&
      is_constrained_everywhere(scene, cut_for(scene, surface).surface))
    throw std::runtime_error(
        place_of(scene, "supports", file) +
        "supports hold the whole surface in all directions, expected a part of it that is "
        "free to move");
}

std::vector<std::string> warnings_about(const Scene& scene, const SurfaceMesh& surface,
                                        const std::string& file) {
  std::vector<std::string> warnings;
  const auto warn = [&](const auto&... words) {
    std::ostringstream text;
    (text << ... << words);
    warnings.push_back(text.str());
  };
  constexpr double kSoftest = 1, kLongest = 50, kShortest = 1e-4;  // Pa, m, m
  if (scene.material.E < kSoftest)
    warn(place_of(scene, "material.E", file), "material.E = ", scene.material.E,
         " Pa is softer than any solid: is it in other units?");
  const bool has_unit = scene.surface.unit != LengthUnit::Metre;
  if (scene.surface.normalise && (has_unit || scene.surface.scale != 1)) {
    const std::string key = has_unit ? "surface.unit" : "surface.scale";
    warn(place_of(scene, key, file), key, " has no effect with surface.normalise, which makes the smallest ",
         "side 1 m: analysis/scenes/own_body.toml keeps a body's size");
  }
  const Eigen::Vector3d box = surface.X.rowwise().maxCoeff() - surface.X.rowwise().minCoeff();
  if (box.maxCoeff() > kLongest || box.maxCoeff() < kShortest)
    warn(place_of(scene, "surface", file), "the body measures ", box(0), " x ", box(1), " x ", box(2),
         " m: are its coordinates millimetres? --units mm, or surface.unit = \"mm\", says so");
  constexpr double kMostNeedles = 0.01;  // of the triangles
  const SurfaceMesh cut = cut_for(scene, surface).surface;
  const Needles needles = needles_of(cut);
  const std::string& source = scene.surface.file;
  if (needles.n > kMostNeedles * static_cast<double>(cut.F.cols()))
    warn(source, ": ", needles.n, " of ", cut.F.cols(),
         cut.cuts.F.size() > 0 ? " triangles as they are cut" : " triangles", " are needles (aspect above ",
         kNeedleAspect, ", at worst ", needles.worst,
         "), which meshers take minutes for or fail on: ", "./testbed run --remesh makes an even surface");
  if (const auto pairs = self_intersections(surface); !pairs.empty())
    warn(source, ": ", pairs.size(), " pairs of triangles cross, which no mesher fills: ",
         "./testbed meshing check names the first, ./testbed run --remesh makes a surface without");
  return warnings;
}

std::string unscalable_part(const Scene& scene) {
  if (!has_load(scene)) return "no gravity and no load: there is nothing to scale";
  if (is_prescribed(scene)) return "prescribed displacements: they do not grow with the loads";
  if (scene.collapse) return "collapse: it shrinks rest lengths, whatever the loads";
  if (scene.time.mode == TimeMode::Dynamic)
    return "time.mode = \"dynamic\": its strain depends on its motion, not on loads alone";
  return large_strain_part(scene);
}

void check_scene(const Scene& scene, const std::string& file) {
  const auto expect = [&](bool is_right, const std::string& key, const auto&... words) {
    if (is_right) return;
    std::ostringstream what;
    what << place_of(scene, key, file);
    (what << ... << words);
    throw std::runtime_error(what.str());
  };
  const bool has_file = !scene.surface.file.empty(), has_shape = !scene.surface.shape.empty();
  expect(has_file != has_shape, has_file ? "surface.shape" : "surface",
         "surface.file and surface.shape are both ", has_file ? "given" : "missing",
         ", expected one of them");

  if (scene.material.law == MaterialLaw::SmallStrain) {
    const std::string part = large_strain_part(scene);
    expect(part.empty(), "material.law", "material.law = small_strain, expected neo_hookean with ", part);
  }

  if (scene.load_scale.strain) {
    const std::string part = unscalable_part(scene);
    expect(part.empty(), "load_scale.strain", "load_scale.strain = ", *scene.load_scale.strain,
           ", expected proportional loads alone, not ", part);
  }

  for (const Event& event : scene.events) check_scene(*event.after, file);
  const TimeOptions& time = scene.time;
  if (scene.volume && scene.volume->is_exact) {
    const VolumeForces& volume = *scene.volume;
    expect(volume.coefficient == 0, "volume.coefficient", "volume.coefficient = ", volume.coefficient,
           ", expected 0 with volume.exact");
    expect(!volume.target.empty(), "volume.exact", "volume.exact = true, expected a volume.target to hold");
    expect(value_at(volume.target, 0) == 1, "volume.target", "volume.target = ", value_at(volume.target, 0),
           " at 0, expected 1 with volume.exact, as bodies begin at rest");
    expect(time.mode == TimeMode::Static || time.sleep_below == 0, "time.sleep_below",
           "time.sleep_below = ", time.sleep_below, ", expected 0 with volume.exact");
  }

  const bool has_contacts = !scene.obstacles.empty() || scene.self_contact.is_on;
  if (time.mode == TimeMode::Static) {
    for (size_t s = 0; s < scene.supports.size(); ++s) {
      const std::string key = "supports." + std::to_string(s) + ".end";
      if (const auto end = scene.supports[s].end)
        expect(false, key, key, " = ", toml_text(*end), ", expected none with time.mode = static");
    }
    expect(!scene.self_contact.is_on, "self_contact",
           "self_contact.on = true, expected false with time.mode = static");
  } else {
    expect(time.sleep_below == 0 || scene.handles.empty(), "time.sleep_below",
           "time.sleep_below = ", time.sleep_below, ", expected 0 with handles, which may wake the body");
    expect(time.tolerance == 0 || !has_contacts, "time.tolerance", "time.tolerance = ", time.tolerance,
           ", expected 0 with obstacles or self_contact");
    try {
      if (time.step > 0) n_steps(time, time.step);
    } catch (const std::runtime_error& error) {
      expect(false, "time.step", error.what());
    }
  }
  if (scene.network.target_error > 0 && scene.collapse)
    expect(scene.collapse->surface || scene.collapse->depth, "collapse.surface",
           "collapse.surface = false with network.target_error, expected collapse.depth, as its default "
           "hangs on the triangles");
  if (scene.skin && scene.skin->relaxation > 0)
    expect(scene.skin->bending > 0, "skin.relaxation", "skin.relaxation = ", scene.skin->relaxation,
           ", expected skin.bending > 0 to drive it");
}

}  // namespace testbed::meshing
