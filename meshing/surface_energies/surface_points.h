// Points of a surface that hang on the nodes of a program.
#pragma once

#include <Eigen/SparseCore>

#include "meshing/surface_energies/surface_energy.h"

namespace testbed::meshing {

/// A linear map from n nodes to m points [IPC Toolkit's displacement map]: x_p = sum_i W_pi x_i.
using SurfacePoints = Eigen::SparseMatrix<double, Eigen::RowMajor>;

/// Values and derivatives by r and s of the n = 3 or 6 Lagrange functions of a triangle, a row each: those of
/// its corners, where (r, s) is (0, 0), (1, 0) and (0, 1), and of the middles of 01, 12 and 20.
Eigen::Matrix3Xd shape_functions(Eigen::Index n, double r, double s);

/// Triangles between all nodes of faces: four in each of six nodes.
/// @param faces  3 or 6 nodes each
Eigen::Matrix3Xi flat_triangles(const Eigen::MatrixXi& faces);

/// Points at the same places of every triangle, in the order of the triangles.
/// @param faces  3 or 6 nodes each, as shape_functions
/// @param places  barycentric coordinates, 3 x k
SurfacePoints points_on(const Eigen::MatrixXi& faces, const Eigen::Matrix3Xd& places, Eigen::Index n_nodes);

struct ContactPoints {
  struct Share {
    int point, face;
    double area;  ///< of the face at rest, that the point stands for (m2)
  };
  SurfacePoints W;
  std::vector<Share> shares;
};

/// Corners, middles of edges and centroids, at 1/20, 2/15 and 9/20 of a face's area: exact for polynomials of
/// degree 3 [Abramowitz & Stegun 1964, 25.4], so that under uniform pressure corners of curved faces bear
/// nothing. What faces share is one point. None hangs on constrained nodes alone.
/// @param faces  3 or 6 nodes each
/// @param X  nodes at rest (3 x n, m), edges straight
/// @param is_constrained  per node
/// @param is_counted  by the nodes that it hangs on, whether a point is one of them; absent: all are
ContactPoints contact_points(const Eigen::MatrixXi& faces, const Eigen::Matrix3Xd& X,
                             const std::vector<char>& is_constrained, const IsCounted& is_counted = {});

/// W^T H W: what the Hessian at points is at the nodes that they hang on.
SurfaceHessian at_nodes(const SurfaceHessian& H, const SurfacePoints& W);

/// An energy of points, as an energy of the nodes that they hang on. Where vertices are nodes none is needed.
class EnergyOfPoints : public SurfaceEnergy {
 public:
  EnergyOfPoints(std::shared_ptr<SurfaceEnergy> energy, const SurfacePoints& points)
      : energy_(std::move(energy)), W_(points) {}

  void set_load_factor(double factor) override { energy_->set_load_factor(factor); }
  void begin_step(double t, double h, const Eigen::Matrix3Xd& x) override {
    energy_->begin_step(t, h, at_points(x));
  }
  std::shared_ptr<const SurfaceMemory> memory() const override { return energy_->memory(); }
  void remember(std::shared_ptr<const SurfaceMemory> memory) override {
    energy_->remember(std::move(memory));
  }
  /// Moves the nodes of a point by as much as it has to go, and again until all points are where they should be.
  /// Faces that are met stay even so.
  bool keep_out(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& y) const override;
  double energy(const Eigen::Matrix3Xd& x) const override { return energy_->energy(at_points(x)); }
  const char* name() const override { return energy_->name(); }
  double stored(const Eigen::Matrix3Xd& x) const override { return energy_->stored(at_points(x)); }
  double friction(const Eigen::Matrix3Xd& x) const override { return energy_->friction(at_points(x)); }
  double work(const Eigen::Matrix3Xd& x) const override { return energy_->work(at_points(x)); }
  std::vector<Contact> contacts(const Eigen::Matrix3Xd& x) const override {
    return energy_->contacts(at_points(x));
  }
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const override;
  void add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const override;
  double largest_step(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& dx) const override {
    return energy_->largest_step(at_points(x), at_points(dx));
  }
  void follow(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& y) override {
    energy_->follow(at_points(x), at_points(y));
  }
  bool passes_through(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& y) const override {
    return energy_->passes_through(at_points(x), at_points(y));
  }
  bool bounds_steps() const override { return energy_->bounds_steps(); }
  bool is_stiff() const override { return energy_->is_stiff(); }
  bool is_invariant() const override { return energy_->is_invariant(); }

 protected:
  Eigen::Matrix3Xd at_points(const Eigen::Matrix3Xd& x) const { return x * W_.transpose(); }

 private:
  std::shared_ptr<SurfaceEnergy> energy_;
  SurfacePoints W_;
};

}  // namespace testbed::meshing
