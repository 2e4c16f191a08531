// What an energy of the surface answers to the solid that it acts on, whatever that is.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "meshing/algebra/block_matrix.h"
#include "meshing/algebra/newton.h"
#include "meshing/base/archive.h"
#include "meshing/surface_energies/enclosed_volume.h"

namespace testbed::meshing {

/// Four nodes and what is between them: e = sum w_a x_a
/// joins the nearest points of two of the surface's parts.
struct NearPair {
  std::array<int, 4> node;
  std::array<double, 4> weight;
  Eigen::Vector3d normal;  ///< from the second part to the first, as they lay when they met
  double stiffness = 0;    ///< N/m
};

/// factor d2V/dx2 (N/m), V the volume enclosed by the straight triangles F at positions x.
struct VolumeCurvature {
  double factor;              ///< Pa
  const Eigen::Matrix3Xi* F;  ///< outlives it
  Eigen::Matrix3Xd x;
};

/// Hessian (N/m) of surface energies, whose entries may lie outside the solid's pattern.
struct SurfaceHessian {
  std::vector<Eigen::Matrix3d> diagonal;  ///< a block per node; empty: none
  std::vector<NearPair> pairs;            ///< each adds stiffness (w_a n)(w_b n)^T between its nodes a and b
  std::vector<SymmetricBlock> blocks;     ///< which add up
  std::vector<Eigen::Matrix3Xd> roots;    ///< each adds g g^T on the first nodes, all of which it couples
  std::vector<VolumeCurvature> curvatures;

  bool empty() const;
  void clear();
  void scale(double factor);

  /// Adds factor d2V/dx2 (Pa), V the volume enclosed by the faces, which outlive it, at positions x.
  void add_volume(double factor, const Faces& faces, const Eigen::Matrix3Xd& x);

  /// Adds its diagonal blocks, but for those of roots and curvatures.
  void add_diagonal(std::vector<Eigen::Matrix3d>& blocks) const;

  /// Adds its diagonal, and those of its blocks that the pattern of A has a place for.
  void add_within(BlockMatrix& A) const;

  /// Calls visit(i, j, block) for blocks as SymmetricBlock whose sum it is, but for its roots.
  template <class Visit>
  void for_each_block(const Visit& visit) const {
    for (size_t i = 0; i < diagonal.size(); ++i) visit(static_cast<int>(i), static_cast<int>(i), diagonal[i]);
    for (const NearPair& pair : pairs)
      for (int a = 0; a < 4; ++a)
        for (int b = a; b < 4; ++b)
          visit(pair.node[a], pair.node[b],
                Eigen::Matrix3d(pair.stiffness * pair.weight[a] * pair.weight[b] * pair.normal *
                                pair.normal.transpose()));
    for (const SymmetricBlock& b : blocks) visit(b.i, b.j, b.block);
    for (const VolumeCurvature& c : curvatures)
      for (const auto& t : c.F->colwise()) {
        const EnclosedVolume v = enclosed_volume(c.x(Eigen::all, t));
        for (int a = 0; a < 3; ++a)
          for (int b = a; b < 3; ++b)
            visit(t(a), t(b), Eigen::Matrix3d(c.factor * v.hessian.block<3, 3>(3 * a, 3 * b)));
      }
  }

  /// y += H p on the first three rows, without roots and curvatures; sums over pairs are in double precision.
  template <class Field>
  void add_sparse_product(const Field& p, Field& y) const {
    using Scalar = typename Field::Scalar;
    for (size_t i = 0; i < diagonal.size(); ++i)
      y.col(i).template head<3>() += diagonal[i].template cast<Scalar>() * p.col(i).template head<3>();
    for (const NearPair& pair : pairs) {
      double closing = 0;
      for (int a = 0; a < 4; ++a)
        closing +=
            pair.weight[a] * pair.normal.dot(p.col(pair.node[a]).template head<3>().template cast<double>());
      for (int a = 0; a < 4; ++a)
        y.col(pair.node[a]).template head<3>() +=
            (pair.stiffness * closing * pair.weight[a] * pair.normal).template cast<Scalar>();
    }
    meshing::add_product(blocks, p, y);
  }

  /// y += H p, 3 x n.
  void add_product(const Eigen::Matrix3Xd& p, Eigen::Matrix3Xd& y) const;
  /// The same in single precision.
  /// @param single  of single_roots
  void add_product(const std::vector<PaddedField>& single, const PaddedField& p, PaddedField& y) const;
  std::vector<PaddedField> single_roots() const;
};

/// Two of the surface's parts that may meet.
struct SidedPair {
  std::array<int, 4> node;
  bool is_edges;         ///< edge 0-1 and edge 2-3; else vertex 0 and triangle 1-2-3
  Eigen::Vector3d side;  ///< direction from the second to the first when they were last apart
};

/// What an energy knows of the steps so far, which decides those to come.
struct SurfaceMemory {
  Eigen::Matrix3Xd listed;       ///< where the nodes were when pairs were listed (m)
  std::vector<SidedPair> pairs;  ///< ascending
  Eigen::VectorXd rest_length;   ///< of a membrane's edges (m)
  double pressure = 0;           ///< that holds a volume (Pa)
};

/// What an obstacle does to a surface.
struct Contact {
  Eigen::Vector3d force{0, 0, 0};  ///< on the surface, friction included (N)
  double area = 0;                 ///< of the surface at rest that is in touch, as it faces the obstacle (m2)
};
inline void archive(Archive& a, SidedPair& pair) {
  a(pair.node, pair.is_edges, pair.side);
}
inline void archive(Archive& a, SurfaceMemory& memory) {
  a(memory.listed, memory.pairs, memory.rest_length, memory.pressure);
}

/// An energy of the positions x (3 x n, m), in the order in which a step by Newton's method calls it.
class SurfaceEnergy {
 public:
  virtual ~SurfaceEnergy() = default;

  /// Loads act with this part of their full strength from here on; in motion they always have all of it.
  virtual void set_load_factor(double) {}

  /// A step of h seconds begins at t (s) and x: what it keeps fixed meanwhile is taken from there.
  virtual void begin_step(double, double, const Eigen::Matrix3Xd&) {}

  /// What it remembers besides what the next begin_step is told; null: nothing.
  virtual std::shared_ptr<const SurfaceMemory> memory() const { return {}; }
  virtual void remember(std::shared_ptr<const SurfaceMemory>) {}

  /// Moves the first guess y to where the energy is finite, coming from x. Returns whether it had to.
  virtual bool keep_out(const Eigen::Matrix3Xd&, Eigen::Matrix3Xd&) const { return false; }

  virtual double energy(const Eigen::Matrix3Xd& x) const = 0;                         ///< J
  virtual void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const = 0;  ///< N

  /// H += Hessian (N/m), or its positive semidefinite part where curvature is projected. What is stiff has that
  /// part alone.
  virtual void add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const = 0;

  /// What it is called in curves.csv.
  virtual const char* name() const { return "surface"; }
  /// The energy at x without the potential of friction, which nothing gives back (J).
  virtual double stored(const Eigen::Matrix3Xd& x) const { return energy(x); }
  /// What friction has taken since the step began, at x (J).
  virtual double friction(const Eigen::Matrix3Xd&) const { return 0; }
  /// Work of obstacles, or of a target, that move in the step that ends at x, by the forces at its end, as implicit
  /// steps take them (J).
  virtual double work(const Eigen::Matrix3Xd&) const { return 0; }
  /// Size of the forces at x (N) that are the rounding of a sum over the whole surface.
  virtual double rounding(const Eigen::Matrix3Xd&) const { return 0; }
  /// With each obstacle, at the end x of the step.
  virtual std::vector<Contact> contacts(const Eigen::Matrix3Xd&) const { return {}; }

  /// Pressure (Pa) that holds the enclosed volume since the last step; absent: nothing does.
  virtual std::optional<double> holding_pressure() const { return {}; }

  /// Largest part of the step dx from x within which nothing passes through, at most 1.
  virtual double largest_step(const Eigen::Matrix3Xd&, const Eigen::Matrix3Xd&) const { return 1; }

  /// Whether anything passes through on the straight way from x to y, where keep_out did not have the last word: what
  /// supports move may do so.
  virtual bool passes_through(const Eigen::Matrix3Xd&, const Eigen::Matrix3Xd&) const { return false; }

  /// Newton's method went from x to y.
  virtual void follow(const Eigen::Matrix3Xd&, const Eigen::Matrix3Xd&) {}

  /// Newton's method found a minimum at x. Whether a constraint is not met there: the energy has changed, and its
  /// minimum is to be found anew.
  virtual bool renew(const Eigen::Matrix3Xd&) { return false; }

  /// Whether largest_step may be less than 1.
  virtual bool bounds_steps() const { return false; }

  /// Whether it is contact, so stiff that Newton's method ends by its last correction and not by forces.
  virtual bool is_stiff() const { return false; }

  /// Whether rigid motions of the body leave the energy as it is.
  virtual bool is_invariant() const { return true; }
};

// Members of one name would hide these verbs.
template <class Energy>
double energy_of(const Energy& of, const Eigen::Matrix3Xd& x) {
  return energy(of, x);
}
template <class Energy, class Sum>
void add_forces_of(const Energy& of, const Eigen::Matrix3Xd& x, Sum& f) {
  add_forces(of, x, f);
}
template <class Energy, class Sum>
void add_hessian_of(const Energy& of, const Eigen::Matrix3Xd& x, Sum& H, Curvature curvature) {
  add_hessian(of, x, H, curvature);
}

/// An energy of positions alone, with the verbs energy, add_forces and add_hessian, as one of the list.
template <class Energy>
class PlainEnergy : public SurfaceEnergy {
 public:
  explicit PlainEnergy(Energy of, const char* name = "surface") : of_(std::move(of)), name_(name) {}
  const char* name() const override { return name_; }
  double energy(const Eigen::Matrix3Xd& x) const override { return energy_of(of_, x); }
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const override { add_forces_of(of_, x, f); }
  void add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const override {
    add_hessian_of(of_, x, H, curvature);
  }

 private:
  Energy of_;
  const char* name_;
};

/// Of a part of an energy, by its nodes, whether it is counted where several processes share the surface.
using IsCounted = std::function<bool(const Eigen::VectorXi& nodes)>;

/// All that acts on a surface, in the order in which it is summed.
using SurfaceEnergies = std::vector<std::shared_ptr<SurfaceEnergy>>;

/// Whether rigid motions of the body leave all of them as they are; if not, they may hold it.
bool is_invariant(const SurfaceEnergies& energies);
/// Of all, as SurfaceEnergy::rounding (N).
double rounding(const SurfaceEnergies& energies, const Eigen::Matrix3Xd& x);
/// Whether any is contact.
bool is_stiff(const SurfaceEnergies& energies);

/// Newton's method again and again until all constraints of the energies are met.
/// @param minimise   goes on from where it ended
/// @param positions  where it ended
NewtonReport minimise_constrained(const SurfaceEnergies& energies,
                                  const std::function<NewtonReport()>& minimise,
                                  const std::function<Eigen::Matrix3Xd()>& positions);

/// Whether anything passes through by any of them.
bool passes_through(const SurfaceEnergies& energies, const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& y);

/// Columns of curves.csv by their names: force (N) of each obstacle on the surface at x, area of contact (m2), and the
/// pressure (Pa) that holds a volume.
/// @param frame  axes of the positions, in columns
std::vector<std::pair<std::string, double>> contact_columns(const SurfaceEnergies& energies,
                                                            const Eigen::Matrix3Xd& x,
                                                            const Eigen::Matrix3d& frame);

/// Memories of those that have any.
using SurfaceMemories = std::vector<std::shared_ptr<const SurfaceMemory>>;
SurfaceMemories memories_of(const SurfaceEnergies& energies);

/// Gives them back. Where there are none, energies keep what they have.
void remember(const SurfaceMemories& memories, const SurfaceEnergies& energies);

}  // namespace testbed::meshing
