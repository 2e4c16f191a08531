// The scene: one physical problem, read from one TOML file by both solvers.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "meshing/base/choices.h"
#include "meshing/base/material.h"
#include "meshing/base/mesh.h"
#include "meshing/surface/cut_surface.h"

namespace testbed::meshing {

struct Everywhere {};
struct Box {
  Eigen::Vector3d low, high;
};
/// Points x with (x - point) . normal <= 0.
struct HalfSpace {
  Eigen::Vector3d point, normal;
};
struct Ball {
  Eigen::Vector3d centre;
  double radius;
};
/// Points within a radius of a segment.
struct Capsule {
  Eigen::Vector3d a, b;
  double radius;
};
/// The inside of a closed surface.
struct ClosedMesh {
  std::string file;
};

/// A part of the body, by the positions of nodes at rest. Boundaries are included (to 1e-9 of the bounding box).
struct Region {
  std::variant<Everywhere, Box, HalfSpace, Ball> shape;
  /// Coordinates are fractions of the surface's bounding box, a radius of its smallest side; normals stay.
  bool relative = false;
};

struct SurfaceSource {
  std::string file;      ///< path, relative to the scene file; empty when `shape` is given
  std::string shape;     ///< of shape_names()
  int n_vertices = 642;  ///< wanted number of vertices of a generated shape; the nearest possible is made
  Eigen::Vector3d size{0, 0, 0};        ///< bounding box of a generated shape (m); 0: the shape's own
  UpAxis up = UpAxis::Y;                ///< axis of the coordinates that is turned to y
  LengthUnit unit = LengthUnit::Metre;  ///< of the coordinates
  double scale = 1;                     ///< factor on all coordinates, before normalise
  bool normalise = false;               ///< smallest side of the bounding box 1 m, centre at the origin
  double across = 1;  ///< edges to fit across the body, for which triangles are cut, see cut_across; 0: any
  int at_supports =
      0;  ///< times that edges at the borders of supports are halved, where stresses are singular
};

/// A value at each time, linear in between and constant outside: (s, value), times ascending. Static scenes
/// take the load factor for time.
using Curve = std::vector<Eigen::Vector2d>;
/// A point or a translation at each time, linear in between: (s, m, m, m).
using Path = std::vector<Eigen::Vector4d>;
double value_at(const Curve& curve, double t);            ///< curve not empty
Eigen::Vector3d position_at(const Path& path, double t);  ///< path not empty

struct Support {
  Region region;
  std::array<bool, 3> fixed{{true, true, true}};  ///< which components are prescribed ("xyz" in the file)
  std::optional<Eigen::Vector3d> normal;          ///< or this direction: nodes stay in the plane across it
  std::optional<Eigen::Vector3d> along;           ///< or what is across this one: nodes move along it
  Eigen::Vector3d displacement{0, 0, 0};          ///< theirs at full load or at the end, grown evenly (m)
  Path motion;                                    ///< theirs over time, instead
  std::optional<double> end;                      ///< s; nothing is prescribed from here on
};

/// Stitches between two parts of the surface: each vertex of the first is tied to the nearest of the second
/// [paper 3.2].
struct Seam {
  Region from, to;
  double stiffness = 0;  ///< of a stitch, whose rest length is zero (N/m)
};

/// A term of a polynomial stress field: exponents i, j, k and the stress xx, yy, zz, yz, xz, xy (Pa) that
/// x^i y^j z^k multiplies.
using StressTerm = Eigen::Matrix<double, 9, 1>;

/// Surface load on triangles whose three vertices lie in the region; on the undeformed area unless stated.
struct Load {
  Region region;
  double pressure = 0;                ///< Pa, acts against the outward normal
  Eigen::Vector3d traction{0, 0, 0};  ///< Pa
  /// The pressure acts on the deformed surface; the region holds whole components of it.
  bool is_follower = false;
  std::vector<StressTerm> stress;  ///< traction = sum of its terms times the outward normal
};

/// Velocity with which a dynamic scene begins; those of regions that overlap add up.
struct InitialMotion {
  Region region;                      ///< of all nodes, inner ones too
  Eigen::Vector3d velocity{0, 0, 0};  ///< m/s
  Eigen::Vector3d spin{0, 0, 0};      ///< rad/s, about the region's centre of mass
};

/// One factor on gravity and all loads, by which a body strains as wanted.
struct LoadScale {
  /// Wanted: a hundredth of the volume strains more. It needs loads that are proportional, see
  /// unscalable_part; the factor for it is found by a trial solve (analysis/load_scale.py).
  std::optional<double> strain;
  std::optional<double> factor;  ///< absent: 1, or still to be found where `strain` is given
};

/// Energies of volume [paper 3.3].
struct VolumeForces {
  double coefficient = 0;  ///< P of 1/2 P (V - V_1)^2 / V_1, V the volume that the surface encloses (Pa)
  double local =
      0;         ///< the same for every tetrahedron of the network; of elements at points of quadrature (Pa)
  Curve target;  ///< V_1 over the volume at rest; absent: 1, and the volume as it is while rest lengths
                 ///< collapse
  bool is_exact = false;  ///< V is V_1, by a pressure that is found
};

/// The surface as a shell of its own around the body [paper 4.2, 4.4].
struct Skin {
  double stiffness = 0;   ///< of the membrane (N/m): thickness times Young's modulus
  double bending = 0;     ///< k_b of 1/2 k_b (theta - theta_0)^2 |e|^2 / (A_1 + A_2) (J)
  double relaxation = 0;  ///< R' of eq. 9, the part lost in a second where the skin is bent most
};

/// Rest lengths collapse around a pivot [paper eq. 8].
struct Pivot {
  Eigen::Vector3d point;      ///< m
  Path motion;                ///< its translation from there
  double start = 0;           ///< s (static scenes: load factor at which it begins)
  std::optional<double> end;  ///< s (static scenes: load factor); no effect from here on
};
struct Collapse {
  double coefficient = 0.1;  ///< depletion R in [0, 1), per second, per step or, static, at full load
  bool is_per_step = false;  ///< as the paper has it: the result depends on the step
  bool surface = true;  ///< springs along the surface collapse too; else it wrinkles, or relaxes by eq. 9
  double least = 0.05;  ///< fraction of its first length below which nothing collapses
  std::vector<Pivot> pivots;
  /// m below a surface that keeps its lengths, over which solids collapse less; absent: one mean edge.
  std::optional<double> depth = {};
};

/// A rigid body that the surface cannot enter.
struct Obstacle {
  std::variant<HalfSpace, Ball, Box, Capsule, ClosedMesh> shape;  ///< what it fills
  Path motion;                                                    ///< its translation from there
  double friction = 0;                                            ///< Coulomb's coefficient
  /// Of its barrier (m); absent: from the body's size.
  std::optional<double> range = {};
  /// Where it overlaps the body as a motion begins: the body is pushed out by statics.
  Overlap initially = Overlap::Refuse;
};

/// A spring between a part of the surface and a point that moves, as a hand pulls it. On one vertex it has no limit
/// under refinement: a solid gives way to a force at a point without bound.
struct Handle {
  std::optional<int> vertex;  ///< of the surface as its file has it, merged
  Region region;              ///< or all vertices in it, each with an equal share of the stiffness
  double stiffness = 0;       ///< N/m
  Path motion;                ///< of its end from the vertices at rest; none: it stays there
  double start = 0;           ///< s (static scenes: load factor)
  std::optional<double> end;  ///< s (static scenes: load factor); it lets go
};

/// The surface against itself.
struct SelfContact {
  bool is_on = false;
  std::optional<double> thickness;  ///< m, that it keeps; from its edges if absent
  double friction = 0;              ///< Coulomb's coefficient
};

struct TimeOptions {
  TimeMode mode = TimeMode::Static;
  int load_steps = 10;      ///< static: loads grow linearly to full in this many steps
  double residual = 1e-10;  ///< forces out of balance over load plus internal forces, and inertia, at the end
  double step = 0;          ///< dynamic: s; 0 chooses one
  double end = 1;           ///< dynamic: s
  std::string integrator = "implicit_euler";  ///< name of the scheme that springs are stepped by
  /// Dynamic: error of a part of a step over the body's size; 0: steps are taken whole.
  double tolerance = 0;
  double sleep_below = 0;       ///< dynamic: a body slower than this, and staying so, is not stepped (m/s)
  bool volume_gradient = true;  ///< linearised: in the matrix, else volume forces are taken as they were
  bool bend_gradient = true;    ///< the same of bending
  Krylov linear_solver = Krylov::Cg;  ///< linearised
};

/// Distances that are absent are chosen from the surface.
struct NetworkOptions {
  std::optional<double> phi;  ///< least distance between internal nodes (normalised box)
  std::optional<double> psi;  ///< least distance of an internal node to the surface (normalised box)
  std::optional<int> k;       ///< internal nodes wanted; absent: as many as fit, see sample_interior
  int multiplicity = 5;       ///< springs projected by each white node, >= 3
  double degree_weight = 0;   ///< of PCP's priority: a spring's, as a distance (normalised box)
  double depth_weight = 0;    ///< of PCP's priority: of a node's depth below the surface beside its distance
  PcpReading reading = PcpReading::StageWise;  ///< of PCP's pseudocode
  std::uint64_t seed = 1;
  std::string sampling = "darts";    ///< of the internal nodes: darts, relaxed, graded or mesher
  double spacing = 0.7;              ///< mesher: edges inside over the surface's nearby
  std::string connectivity = "pcp";  ///< of Connectivity
  int neighbours = 8;                ///< completed_pcp: nearest neighbours of every node
  SpringLaw spring_law = SpringLaw::Hooke;
  double spring_damping = 0;  ///< k_d of every independent spring (N s/m)
  double link_share = 0;      ///< of the material that the network's links stand for beside coupled springs
  std::string calibration = "node_averaged";  ///< name of the spring model
  MassMatrix mass =
      MassMatrix::Consistent;  ///< of coupled springs in all but explicit steps; all else is lumped
  bool estimate = true;        ///< the error of coupled springs in statics
  double target_error = 0;     ///< of theirs, until which nodes are added; 0: none are
};

struct ReferenceOptions {
  int degree = 2;                                ///< polynomial degree of the displacement, 1 or 2
  std::optional<double> interior_size;           ///< m; from the surface's edges if absent
  int refine = 0;                                ///< uniform refinements of the tetrahedra
  MassMatrix mass = MassMatrix::Consistent;      ///< of all but central differences, whose mass is lumped
  std::string integrator = "generalised_alpha";  ///< name of the scheme that the reference steps by
  /// Of the generalised-alpha method: what is left per step of the highest frequencies, in [0, 1]; absent:
  /// Newmark's average acceleration, which damps none.
  std::optional<double> spectral_radius;
  bool inertia_relief = false;  ///< static: inertia balances loads that drive free rigid motions
};

struct ComparisonOptions {
  std::vector<std::string> calibrations;  ///< spring models to run beside network.calibration
};

struct OutputOptions {
  int frames_every = 1;  ///< load or time steps between frames; 0: none but the last
  bool curves = true;
  double checkpoint_every = 60;  ///< s of wall-clock time between checkpoints of a motion; 0: none
};

/// The film of the deflation played backwards is an inflation [paper 4].
struct PlaybackOptions {
  std::string warp;         ///< of time; "": no film
  bool is_reversed = true;  ///< the end comes first
  double seconds = 4;       ///< of the film
  double fps = 25;          ///< 1/s
  Curve points;             ///< of a custom warp: [[share of the film, share of the simulation], ...]
  std::string expression;   ///< or the same in t
};

struct Scene;

/// A value that changes on the way, as a user changes it in a preview. The springs obey it before the first step that
/// begins at its time or later.
struct Event {
  double time = 0;                          ///< s (static scenes: load factor)
  std::string key, value;                   ///< as --set has them
  std::shared_ptr<const Scene> after = {};  ///< the scene from then on, without events
};

struct Scene {
  std::string name;
  bool is_paper = false;  ///< springs as the PCP paper has them, whatever other keys say
  SurfaceSource surface;
  Material material;
  std::optional<Eigen::Vector3d> gravity;  ///< m/s2
  std::vector<Support> supports;
  std::vector<Seam> seams;
  std::vector<Load> loads;
  std::vector<InitialMotion> initial;
  LoadScale load_scale;
  std::optional<Collapse> collapse;
  std::optional<VolumeForces> volume;
  std::optional<Skin> skin;
  std::vector<Obstacle> obstacles;
  SelfContact self_contact;
  std::vector<Handle> handles;
  std::vector<Event> events;  ///< ascending times
  TimeOptions time;
  NetworkOptions network;
  ReferenceOptions reference;
  ComparisonOptions comparison;
  PlaybackOptions playback;
  OutputOptions output;
  /// Where its keys were given: "loads.0.region" -> "scene.toml:12" or "--set loads.0.region=...".
  std::map<std::string, std::string> places;
};

/// The factor on gravity and all loads.
/// @throws std::runtime_error where a strain is wanted and the factor for it has not been found.
double load_factor_of(const Scene& scene);

/// Gravity times that factor (m/s2); absent where there is none.
std::optional<Eigen::Vector3d> gravity_of(const Scene& scene);

/// The part of the scene that small strain does not describe, and why; empty: none.
std::string large_strain_part(const Scene& scene);

/// The scene's law, of both solvers: where it names none, neo-Hookean with such a part, else small strain. The
/// paper's method is neo-Hookean.
MaterialLaw law_of(const Scene& scene);

/// The sum of a polynomial stress field's terms at x (Pa).
Eigen::Matrix3d stress_at(const std::vector<StressTerm>& terms, const Eigen::Vector3d& x);

/// Steps of a motion whose scene leaves their length to the program.
constexpr int kDefaultSteps = 200;

/// Reads a scene with `overrides` in place: "material.nu=0.3", "loads.0.pressure=5", the value in TOML or
/// else a string. Paths are relative to the scene file, in overrides to the current folder, and absolute in
/// the result, where the law is filled in.
/// @throws std::runtime_error naming file, line, key, value found, what is allowed and the nearest known key.
Scene read_scene(const std::filesystem::path& file, const std::vector<std::string>& overrides = {});

/// Adds an override, in place of an earlier one of its key.
void add_override(std::vector<std::string>& overrides, const std::string& key, const std::string& value);

/// Steps of a length (s) to time.end: at least one, and the last may end beyond it.
/// @throws std::runtime_error with their number when an int does not hold it.
int n_steps(const TimeOptions& time, double step);

/// A key of a scene: "network.phi", its value in TOML (empty: absent) and meaning.
struct SceneKey {
  std::string path, value, meaning;
  bool is_chosen;  ///< it has no default: whoever writes its table must give it
};

/// Every key of the scene, in the order of to_toml; those in a list of tables once for each.
std::vector<SceneKey> keys_of(const Scene& scene);

/// The scene with every default filled in and every key explained, as TOML that read_scene accepts.
std::string to_toml(const Scene& scene);

/// The scene's surface: file or generated shape, turned upright and scaled, checked to be closed and oriented
/// outward.
/// @throws std::runtime_error when it cannot be read or is not closed, which names the commands that mend it.
SurfaceMesh load_surface(const SurfaceSource& source);

/// The surface with its triangles cut as surface.across and surface.at_supports ask. Regions stay as they are.
/// @param coarser  as for cut_across
CutSurface cut_for(const Scene& scene, const SurfaceMesh& surface, double coarser = 1);

/// That points (3 x n) span.
Box box_of(const Eigen::Matrix3Xd& X);
/// Indices (ascending) of the nodes X (3 x n, m) in the region of a body, which fills that box.
std::vector<int> nodes_in(const Region& region, const Eigen::Matrix3Xd& X, const Box& body);
/// Indices (ascending) of the surface vertices in the region.
std::vector<int> vertices_in(const Region& region, const SurfaceMesh& surface);
/// Indices (ascending) of the triangles with all three vertices in the region.
std::vector<int> triangles_in(const Region& region, const SurfaceMesh& surface);

}  // namespace testbed::meshing
