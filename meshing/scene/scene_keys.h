// The scene file's one table: key, place, what is allowed, meaning. The reader and the writer of scenes both
// walk it.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "meshing/scene/scene.h"
#include "meshing/surface/shapes.h"

namespace testbed::meshing {

/// What a number may be, in words and as a test.
struct Range {
  const char* expected;
  bool (*holds)(double);
};
inline const Range kAny{"a number", [](double) { return true; }};
inline const Range kPositive{"> 0", [](double x) { return x > 0; }};
inline const Range kModulus{"from 1e-9 to 1e20", [](double x) { return x >= 1e-9 && x <= 1e20; }};
inline const Range kNotNegative{">= 0", [](double x) { return x >= 0; }};
inline const Range kPoisson{"in (-1, 0.5)", [](double x) { return x > -1 && x < 0.5; }};
inline const Range kFraction{"in [0, 1)", [](double x) { return x >= 0 && x < 1; }};
inline const Range kAtLeastOne{">= 1", [](double x) { return x >= 1; }};
inline const Range kAtLeastThree{">= 3", [](double x) { return x >= 3; }};
inline const Range kUpToOne{"in [0, 1]", [](double x) { return x >= 0 && x <= 1; }};
inline const Range kHalvings{"from 0 to 8", [](double x) { return x >= 0 && x <= 8; }};
inline const Range kDegree{"1 or 2", [](double x) { return x == 1 || x == 2; }};

inline const std::vector<std::string> kSamplings = [] {
  std::vector<std::string> names = all_names<Sampling>();
  names.emplace_back("mesher");
  return names;
}();
inline const std::vector<std::string> kWarps{"constant", "elastic", "explode", "custom"};

/// Of a folder, within the one that it is made in.
inline bool is_name(const std::string& name) {
  return !name.empty() && name != "." && name != ".." &&
         name.find_first_of(std::string("/\0", 2)) == std::string::npos;
}

/// The times in front ascend.
template <class Rows>
bool is_ascending(const Rows& rows) {
  for (size_t i = 1; i < rows.size(); ++i)
    if (!(rows[i - 1](0) < rows[i](0))) return false;
  return true;
}

/// Of a degree that both solvers integrate exactly.
inline bool is_polynomial(const std::vector<StressTerm>& terms) {
  return std::all_of(terms.begin(), terms.end(), [](const StressTerm& term) {
    const Eigen::Array3d exponents = term.head<3>();
    return (exponents >= 0).all() && (exponents == exponents.floor()).all() && exponents.sum() <= 3;
  });
}

template <class V>
void describe(V&, Everywhere&) {}

template <class V>
void describe(V& v, Box& box) {
  v.required("low", box.low, kAny, "corner (m)");
  v.required("high", box.high, kAny, "opposite corner (m)");
  v.check("high", (box.low.array() <= box.high.array()).all(), "no component below low");
}

template <class V>
void describe(V& v, HalfSpace& half) {
  v.required("point", half.point, kAny, "on the plane (m)");
  v.required("normal", half.normal, kAny, "out of the half space");
  v.check("normal", half.normal.norm() > 0, "a vector other than zero");
}

template <class V>
void describe(V& v, Ball& ball) {
  v.required("center", ball.centre, kAny, "m");
  v.required("radius", ball.radius, kPositive, "m");
}

template <class V>
void describe(V& v, Capsule& capsule) {
  v.required("a", capsule.a, kAny, "end of its axis (m)");
  v.required("b", capsule.b, kAny, "other end (m)");
  v.required("radius", capsule.radius, kPositive, "m");
}

template <class V>
void describe(V& v, ClosedMesh& mesh) {
  v.path("file", mesh.file, "closed surface, as in [surface]");
}

template <class V>
void describe(V& v, Region& region) {
  v.template alternative<Box>("box", region.shape);
  v.template alternative<HalfSpace>("plane", region.shape);
  v.template alternative<Ball>("sphere", region.shape);
  v("relative", region.relative, "in fractions of the bounding box");
}

template <class V>
void describe(V& v, SurfaceSource& s) {
  v.path("file", s.file, "closed surface: .obj .off .ply .stl .vtp .vtu, relative to this file");
  v.choice("shape", s.shape, shape_names(),
           "or a generated one: ball, hollow_ball, torus, bar, handle, head");
  v("n_vertices", s.n_vertices, kAtLeastOne, "of a generated shape, about");
  v("size", s.size, kNotNegative, "bounding box of a generated shape (m), 0: its own");
  v.choice("up", s.up, "axis of its coordinates that points up, y or z: z is turned to y");
  v.choice("unit", s.unit, "of its coordinates: m, cm, mm or in");
  v("scale", s.scale, kPositive, "factor on all coordinates");
  v("normalise", s.normalise, "scale so that the bounding box's smallest side is 1 m, centre at the origin");
  v("across", s.across, kNotNegative,
    "cut triangles in their planes until this many edges fit across the body; 0: none; not for networks of "
    "links, as PCP makes");
  v("at_supports", s.at_supports, kHalvings,
    "halve the edges at borders of supports so many times, where stresses are singular; likewise not for "
    "links");
}

template <class V>
void describe(V& v, Material& m) {
  v("E", m.E, kModulus, "Young's modulus (Pa)");
  v("nu", m.nu, kPoisson, "Poisson's ratio");
  v("rho", m.rho, kPositive, "density (kg/m3)");
  v("damping", m.damping, kNotNegative, "mass-proportional damping (1/s)");
  v("damping_ratio", m.damping_ratio, kNotNegative,
    "of the lowest vibration, over critical, by mass-proportional damping as well");
  v("stiffness_damping", m.stiffness_damping, kNotNegative,
    "stiffness-proportional damping (s), elements only");
  v.choice("law", m.law,
           "small_strain or neo_hookean, of both solvers; absent: neo_hookean with obstacles, self_contact, "
           "seams, skin, volume, a follower load, a collapse in time or the spin of a body without supports");
}

template <class V>
void describe(V& v, Support& s) {
  v.inline_table("region", s.region, "which surface nodes");
  v("normal", s.normal, kAny, "instead of components: nodes stay in the plane across it through their rest");
  v.check("normal", !s.normal || s.normal->norm() > 0, "a vector other than zero");
  v("along", s.along, kAny, "instead of components: nodes move along this axis only");
  v.check("along", !s.along || s.along->norm() > 0, "a vector other than zero");
  v.at_most_one({"components", "normal", "along"});
  if (!s.normal && !s.along) v.components("components", s.fixed, "prescribed components");
  v("displacement", s.displacement, kAny, "theirs at full load, or at the end (m)");
  v("motion", s.motion, kAny, "theirs over time instead [[s, m, m, m], ...]; static scenes: load factor");
  v.check("motion", is_ascending(s.motion), "ascending times");
  v.check("motion", s.motion.empty() || s.displacement.isZero(0), "no displacement besides");
  v("end", s.end, kPositive, "s, of a dynamic scene: its nodes are free from then on");
}

template <class V>
void describe(V& v, Seam& s) {
  v.inline_table("from", s.from, "vertices that are tied");
  v.inline_table("to", s.to, "each to the nearest of these");
  v.required("stiffness", s.stiffness, kPositive, "of a stitch, whose rest length is zero (N/m)");
}

template <class V>
void describe(V& v, Load& l) {
  v.inline_table("region", l.region, "triangles with three nodes inside");
  v("pressure", l.pressure, kAny, "against the outward normal (Pa)");
  v("traction", l.traction, kAny, "Pa");
  v("stress", l.stress, kAny,
    "traction = stress times outward normal, the sum of terms x^i y^j z^k: [[i, j, k, xx, yy, zz, yz, xz, "
    "xy], "
    "...] (Pa)");
  v.check("stress", is_polynomial(l.stress), "whole exponents i, j, k from 0, their sum at most 3");
  v("follower", l.is_follower, "pressure acts on the deformed surface");
}

template <class V>
void describe(V& v, InitialMotion& m) {
  v.inline_table("region", m.region, "which nodes, inner ones too");
  v("velocity", m.velocity, kAny, "at the start (m/s); that of supports has precedence");
  v("spin", m.spin, kAny, "about the region's centre of mass (rad/s)");
}

template <class V>
void describe(V& v, LoadScale& s) {
  v("strain", s.strain, kPositive,
    "wanted, exceeded in a hundredth of the volume: one factor on gravity and loads is found for it");
  v("factor", s.factor, kPositive, "on gravity and all loads; absent: 1, or found for the wanted strain");
}

template <class V>
void describe(V& v, Pivot& p) {
  v.required("point", p.point, kAny, "m");
  v("motion", p.motion, kAny, "translation from there [[s, m, m, m], ...]");
  v.check("motion", is_ascending(p.motion), "ascending times");
  v("start", p.start, kNotNegative, "s; static scenes: load factor");
  v("end", p.end, kPositive, "s, static scenes: load factor; no effect from then on");
}

template <class V>
void describe(V& v, Collapse& c) {
  v("coefficient", c.coefficient, kFraction, "depletion R of rest lengths in a second; static: at full load");
  v("per_step", c.is_per_step, "deplete by R in a step, whatever its length");
  v("surface", c.surface,
    "the surface collapses, too; else links along it keep their length, so that it wrinkles or relaxes, and "
    "the collapse of elements and coupled springs fades to none at it");
  v("least", c.least, kUpToOne,
    "fraction of its first length to which a spring or an element collapses at most");
  v("depth", c.depth, kPositive,
    "with surface = false: below the surface at rest, from where on elements and coupled springs collapse in "
    "full (m); absent: one mean edge of the surface");
  v.list("pivots", c.pivots);
}

template <class V>
void describe(V& v, VolumeForces& f) {
  v("coefficient", f.coefficient, kNotNegative, "P, of the enclosed volume (Pa)");
  v("local", f.local, kNotNegative, "of every tetrahedron, or of elements at points of quadrature (Pa)");
  v("target", f.target, kPositive,
    "[[s, volume over that at rest], ...]; absent: 1, or what a collapse leaves");
  v.check("target", is_ascending(f.target), "ascending times");
  v("exact", f.is_exact,
    "the enclosed volume is the target at the end of every step, by a pressure that curves.csv tells; in "
    "motion "
    "by minimising_euler of both programs");
}

template <class V>
void describe(V& v, Skin& s) {
  v("stiffness", s.stiffness, kNotNegative, "of the membrane: thickness times Young's modulus (N/m)");
  v("bending", s.bending, kNotNegative, "k_b (J)");
  v("relaxation", s.relaxation, kFraction, "R': part of a rest length lost in a second where bent most");
}

template <class V>
void describe(V& v, Obstacle& o) {
  v.template alternative<HalfSpace>("plane", o.shape);
  v.template alternative<Ball>("sphere", o.shape);
  v.template alternative<Box>("box", o.shape);
  v.template alternative<Capsule>("capsule", o.shape);
  v.template alternative<ClosedMesh>("mesh", o.shape);
  v.needs_alternative("plane, sphere, box, capsule or mesh");
  v("motion", o.motion, kAny, "translation [[s or load factor, m, m, m], ...]");
  v.check("motion", is_ascending(o.motion), "ascending times");
  v("friction", o.friction, kNotNegative, "Coulomb's coefficient");
  v("range", o.range, kPositive,
    "below which a barrier presses the surface away (m); absent: a thousandth of the body's diagonal");
  v.choice("initially", o.initially,
           "where it overlaps the body as a motion begins: refuse, or resolve, which pushes the body out by "
           "statics");
}

template <class V>
void describe(V& v, SelfContact& c) {
  v("on", c.is_on, "the surface does not pass through itself");
  v("thickness", c.thickness, kPositive, "distance that it keeps (m); absent: from its edges");
  v("friction", c.friction, kNotNegative, "Coulomb's coefficient, where a barrier keeps it");
}

template <class V>
void describe(V& v, Handle& h) {
  v("vertex", h.vertex, kNotNegative, "of the surface, counted from 0; else those in region");
  v.at_most_one({"vertex", "region"});
  if (!h.vertex) v.inline_table("region", h.region, "which vertices share the stiffness evenly");
  v.required("stiffness", h.stiffness, kPositive, "of the spring that pulls (N/m)");
  v("motion", h.motion, kAny, "of the spring's other end from there [[s or load factor, m, m, m], ...]");
  v.check("motion", is_ascending(h.motion), "ascending times");
  v("start", h.start, kNotNegative, "s; static scenes: load factor");
  v("end", h.end, kPositive, "s, static scenes: load factor; it lets go");
}

template <class V>
void describe(V& v, Event& e) {
  v.required("time", e.time, kNotNegative, "s, static scenes: load factor");
  v.required("key", e.key, kAny, "that has another value from the next step on, springs only");
  v.required("value", e.value, kAny, "in TOML, as --set has it");
}

template <class V>
void describe(V& v, TimeOptions& t) {
  v.choice("mode", t.mode, "static (loads grow in load_steps) or dynamic");
  v("load_steps", t.load_steps, kAtLeastOne, "steps to full load of a static scene");
  v("residual", t.residual, kPositive,
    "forces out of balance over load plus internal forces, and inertia, at which statics and implicit steps "
    "stop");
  v("step", t.step, kNotNegative,
    "s, of a dynamic scene; 0: a 200th of end, or half an explicit integrator's stable step");
  v("end", t.end, kPositive, "s, of a dynamic scene");
  v("integrator", t.integrator,
    "dynamic: explicit_euler, symplectic_euler, rk4; implicit_euler (linearised), minimising_euler, "
    "midpoint, bdf2, tr_bdf2");
  v("tolerance", t.tolerance, kNotNegative,
    "divide steps so that each part errs by this fraction of the body's size; 0: never");
  v("sleep_below", t.sleep_below, kNotNegative, "m/s: a body that stays slower is not stepped; 0: never");
  v("volume_gradient", t.volume_gradient, "implicit_euler: volume forces change within a step");
  v("bend_gradient", t.bend_gradient, "implicit_euler: bending forces change within a step");
  v.choice("linear_solver", t.linear_solver, "implicit_euler: cg, bicg or bicgstab");
}

template <class V>
void describe(V& v, NetworkOptions& n) {
  v("phi", n.phi, kPositive, "least distance of internal nodes (normalised box); absent: from the surface");
  v("psi", n.psi, kPositive, "least distance to the surface (normalised box); absent: from the surface");
  v("k", n.k, kNotNegative,
    "internal nodes wanted; absent: as many as fit, at most 3 for each of the surface unless phi is given");
  v("multiplicity", n.multiplicity, kAtLeastThree, "springs projected by each white node");
  v("degree_weight", n.degree_weight, kNotNegative,
    "PCP's priority: a spring of a node counts as this distance (normalised box)");
  v("depth_weight", n.depth_weight, kNotNegative,
    "PCP's priority: of a node's depth below the surface beside its distance");
  v.choice("reading", n.reading, "of PCP's pseudocode: stage_wise, whole_last_stage or literal");
  v("seed", n.seed, kNotNegative, "of the random nodes");
  v.choice("sampling", n.sampling, kSamplings, "of the internal nodes: darts, relaxed, graded, mesher");
  v("spacing", n.spacing, kPositive, "mesher: edges inside over the surface's nearby, less in thin bodies");
  v.choice("connectivity", n.connectivity, all_names<Connectivity>(),
           "surface, central, complete, delaunay, pcp, completed_pcp");
  v("neighbours", n.neighbours, kAtLeastOne, "completed_pcp: nearest neighbours of every node");
  v("calibration", n.calibration, "name of the spring model");
  v.choice("mass", n.mass,
           "of coupled springs: consistent, spread over the tetrahedra (but in explicit steps), or lumped");
  v.choice("spring_law", n.spring_law,
           "of independent springs in compression: hooke, or definite, which no force flattens");
  v("link_share", n.link_share, kFraction,
    "of the material's shear stiffness that the network's links have beside coupled springs");
  v("spring_damping", n.spring_damping, kNotNegative, "k_d of independent springs (N s/m)");
  v("estimate", n.estimate,
    "static: estimate the error of coupled springs, by solving once more, roughly, on tetrahedra split in "
    "eight");
  v("target_error", n.target_error, kFraction,
    "static: add nodes until the estimated error of coupled springs is below; 0: add none");
}

template <class V>
void describe(V& v, ReferenceOptions& r) {
  v("degree", r.degree, kDegree, "of the displacement's polynomials");
  v("interior_size", r.interior_size, kPositive, "edge length inside (m); absent: from the surface");
  v("refine", r.refine, kNotNegative, "times every tetrahedron is split in eight");
  v.choice("mass", r.mass, "consistent or lumped mass matrix; that of central_differences is lumped");
  v("integrator", r.integrator,
    "dynamic: generalised_alpha or minimising_euler, implicit, or central_differences, explicit with half "
    "its "
    "stable step unless time.step is given");
  v("spectral_radius", r.spectral_radius, kUpToOne,
    "of generalised-alpha at the highest frequencies; absent: Newmark, which damps none");
  v("inertia_relief", r.inertia_relief, "static: inertia balances loads that drive free rigid motions");
}

template <class V>
void describe(V& v, ComparisonOptions& c) {
  v("calibrations", c.calibrations, "spring models run beside network.calibration");
}

template <class V>
void describe(V& v, OutputOptions& o) {
  v("frames_every", o.frames_every, kNotNegative, "steps between frames; 0: only the last");
  v("curves", o.curves, "write curves.csv");
  v("checkpoint_every", o.checkpoint_every, kNotNegative,
    "s of wall-clock time between checkpoints, from which a killed motion goes on; 0: none");
}

template <class V>
void describe(V& v, PlaybackOptions& p) {
  v.choice("warp", p.warp, kWarps, "of time: constant, elastic, explode, custom; \"\": no film");
  v("reversed", p.is_reversed, "the end first: deflation becomes inflation");
  v("seconds", p.seconds, kPositive, "s, length of the film");
  v("fps", p.fps, kPositive, "1/s, frames");
  v("points", p.points, kUpToOne, "of custom: [[share of film, share of simulation], ...]");
  v.check("points", is_ascending(p.points), "ascending times");
  v("expression", p.expression, "of custom: share of simulation as a function of t");
}

template <class V>
void describe(V& v, Scene& s) {
  v("name", s.name, "of the output folder");
  v.check("name", is_name(s.name), "the name of a folder: without / and NUL, not . or ..");
  v("paper", s.is_paper,
    "the PCP paper as published: its links, springs, steps, solver and collapse, whatever other keys say");
  v("gravity", s.gravity, kAny, "m/s2");
  v.table("surface", s.surface);
  v.table("material", s.material);
  v.list("supports", s.supports);
  v.list("seams", s.seams);
  v.list("loads", s.loads);
  v.list("initial", s.initial);
  v.table("load_scale", s.load_scale);
  v.table("collapse", s.collapse);
  v.table("volume", s.volume);
  v.table("skin", s.skin);
  v.list("obstacles", s.obstacles);
  v.table("self_contact", s.self_contact);
  v.list("handles", s.handles);
  v.list("events", s.events);
  v.check("events",
          std::is_sorted(s.events.begin(), s.events.end(),
                         [](const Event& a, const Event& b) { return a.time < b.time; }),
          "ascending times");
  v.table("time", s.time);
  v.table("network", s.network);
  v.table("reference", s.reference);
  v.table("comparison", s.comparison);
  v.table("playback", s.playback);
  v.table("output", s.output);
  v.check("initial", s.initial.empty() || s.time.mode == TimeMode::Dynamic,
          "none with time.mode = static: equilibria have no velocity");
  v.check("obstacles",
          s.time.mode == TimeMode::Dynamic ||
              std::none_of(s.obstacles.begin(), s.obstacles.end(),
                           [](const Obstacle& o) { return o.initially == Overlap::Resolve; }),
          "none with initially = resolve in statics, which begin with loads");
  v.check("paper", !s.is_paper || s.time.mode == TimeMode::Dynamic, "false with time.mode = static");
}

/// Shortest decimal digits that give x again, as a TOML float.
std::string toml_text(double x);
/// A TOML string in quotes.
std::string toml_text(const std::string& text);

}  // namespace testbed::meshing
