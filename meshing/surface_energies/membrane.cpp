#include "meshing/surface_energies/membrane.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <map>

#include "meshing/scene/collapse.h"
#include "meshing/surface/surface.h"
#include "meshing/surface_energies/surface_points.h"

namespace testbed::meshing {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

/// D of a triangle with edges e_i: with E of the Green strain e_i^T E e_i = q_i / 2.
Matrix3d energy_of_squares(const Matrix3d& edges, double stiffness, double nu) {
  const Vector3d normal = edges.col(0).cross(edges.col(1)), along = edges.col(0).normalized(),
                 across = normal.cross(along).normalized();
  const Eigen::Array3d a = edges.transpose() * along, b = edges.transpose() * across;
  Matrix3d squares_of_strain;  // E_11, E_22, E_12
  squares_of_strain << 2 * a * a, 2 * b * b, 4 * a * b;
  Matrix3d law;
  law << 1, nu, 0,  //
      nu, 1, 0,     //
      0, 0, 2 * (1 - nu);
  const Matrix3d strain = squares_of_strain.inverse();
  return normal.norm() / 2 * stiffness / (1 - nu * nu) * strain.transpose() * law * strain;
}

}  // namespace

Membrane::Membrane(const Matrix3Xd& X, const Eigen::Matrix3Xi& F, double stiffness, double nu,
                   std::optional<Relaxation> relaxation, std::optional<ShrinkingRest> shrinking)
    : F_(F),
      E_(edges_of(F)),
      edge_(3, F.cols()),
      relaxation_(std::move(relaxation)),
      shrinking_(std::move(shrinking)),
      middles_(middles(X)) {
  std::map<std::pair<int, int>, int> number;
  SurfaceMemory rest;
  rest.rest_length.resize(E_.cols());
  for (int s = 0; s < E_.cols(); ++s) {
    number[std::minmax(E_(0, s), E_(1, s))] = s;
    rest.rest_length(s) = (X.col(E_(0, s)) - X.col(E_(1, s))).norm();
  }
  first_length_ = rest.rest_length;
  memory_ = std::make_shared<const SurfaceMemory>(std::move(rest));
  for (Eigen::Index t = 0; t < F.cols(); ++t) {
    Matrix3d edges;
    for (int k = 0; k < 3; ++k) {
      const int i = F(k, t), j = F((k + 1) % 3, t);
      edges.col(k) = X.col(j) - X.col(i);
      edge_(k, t) = number.at(std::minmax(i, j));
    }
    D_.push_back(energy_of_squares(edges, stiffness, nu));
  }
}

Matrix3Xd Membrane::middles(const Matrix3Xd& x) const {
  return (x(Eigen::all, E_.row(0)) + x(Eigen::all, E_.row(1))) / 2;
}

/// Calls visit(number, q, edges as they are).
template <class Visit>
void Membrane::for_each_triangle(const Matrix3Xd& x, const Visit& visit) const {
  for (Eigen::Index t = 0; t < F_.cols(); ++t) {
    Matrix3d edges;
    Vector3d q;
    for (int k = 0; k < 3; ++k) {
      edges.col(k) = x.col(F_((k + 1) % 3, t)) - x.col(F_(k, t));
      const double r = memory_->rest_length(edge_(k, t));
      q(k) = edges.col(k).squaredNorm() - r * r;
    }
    visit(t, q, edges);
  }
}

double Membrane::energy(const Matrix3Xd& x) const {
  double sum = 0;
  for_each_triangle(x,
                    [&](Eigen::Index t, const Vector3d& q, const Matrix3d&) { sum += q.dot(D_[t] * q) / 2; });
  return sum;
}

void Membrane::add_forces(const Matrix3Xd& x, Matrix3Xd& f) const {
  for_each_triangle(x, [&](Eigen::Index t, const Vector3d& q, const Matrix3d& edges) {
    const Vector3d tension = 2 * D_[t] * q;  // over the edge's length
    for (int k = 0; k < 3; ++k) {
      f.col(F_(k, t)) += tension(k) * edges.col(k);
      f.col(F_((k + 1) % 3, t)) -= tension(k) * edges.col(k);
    }
  });
}

void Membrane::add_hessian(const Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const {
  for_each_triangle(x, [&](Eigen::Index t, const Vector3d& q, const Matrix3d& edges) {
    Vector3d tension = 2 * D_[t] * q;
    if (curvature == Curvature::Projected) tension = tension.cwiseMax(0);
    Matrix3d ends = -Matrix3d::Identity();  // of edge k and corner a: -1 where it begins, 1 where it ends
    for (int k = 0; k < 3; ++k) ends(k, (k + 1) % 3) = 1;
    for (int a = 0; a < 3; ++a)
      for (int b = a; b < 3; ++b) {
        const Matrix3d by_a = 2 * edges * ends.col(a).asDiagonal(),
                       by_b = 2 * edges * ends.col(b).asDiagonal();
        const double along = (ends.col(a).array() * ends.col(b).array() * tension.array()).sum();
        H.blocks.push_back(
            {F_(a, t), F_(b, t), by_a * D_[t] * by_b.transpose() + along * Matrix3d::Identity()});
      }
  });
}

void Membrane::begin_step(double t, double h, const Matrix3Xd& x) {
  if (!relaxation_ && !shrinking_) return;
  auto next = std::make_shared<SurfaceMemory>(*memory_);
  Eigen::VectorXd& length = next->rest_length;
  if (shrinking_) {
    const auto& [collapse, side, frame, is_static] = *shrinking_;
    if (is_static) {
      for (Eigen::Index s = 0; s < length.size(); ++s)
        length(s) = first_length_(s) * static_length(collapse, side, 1, frame * middles_.col(s), t + h);
    } else {
      Eigen::VectorXd left = length.cwiseQuotient(first_length_);
      collapse_in_step(collapse, side, Eigen::VectorXd::Ones(length.size()), frame * middles(x), t, h, left);
      length = first_length_.cwiseProduct(left);
    }
  }
  if (relaxation_)
    relax(relaxation_->bending, E_, relaxation_->coefficient, h, x, length, relaxation_->largest_of);
  memory_ = std::move(next);
}

void Membrane::keep(const std::vector<int>& triangles) {
  F_ = Eigen::Matrix3Xi(F_(Eigen::all, triangles));
  edge_ = Eigen::Matrix3Xi(edge_(Eigen::all, triangles));
  std::vector<Matrix3d> D;
  for (const int t : triangles) D.push_back(D_[t]);
  D_ = std::move(D);
}

SurfaceEnergies skin_of(const Scene& scene, const Matrix3Xd& X, const Eigen::MatrixXi& faces,
                        const Matrix3d& frame, double shortest_side, const IsCounted& is_counted,
                        const LargestOf& largest_of) {
  if (!scene.skin) return {};
  const Skin& skin = *scene.skin;
  const Eigen::Matrix3Xi F = flat_triangles(faces);
  const Bending bending = make_bending(X, F, skin.bending);
  const auto counted = [&](const auto& parts) {
    std::vector<int> places;
    for (int k = 0; k < parts.cols(); ++k)
      if (is_counted(parts.col(k))) places.push_back(k);
    return places;
  };
  SurfaceEnergies energies;
  if (skin.stiffness > 0) {
    std::optional<Relaxation> relaxation;
    if (skin.relaxation > 0 && scene.time.mode == TimeMode::Dynamic)
      relaxation = Relaxation{skin.relaxation, bending, largest_of};
    std::optional<ShrinkingRest> shrinking;
    if (scene.collapse && scene.collapse->surface)
      shrinking = ShrinkingRest{*scene.collapse, shortest_side, frame, scene.time.mode == TimeMode::Static};
    const auto membrane = std::make_shared<Membrane>(X, F, skin.stiffness, scene.material.nu,
                                                     std::move(relaxation), std::move(shrinking));
    if (is_counted) membrane->keep(counted(F));
    energies.push_back(membrane);
  }
  if (skin.bending > 0)
    energies.push_back(std::make_shared<PlainEnergy<Bending>>(
        is_counted ? part_of(bending, counted(bending.hinges)) : bending));
  return energies;
}

}  // namespace testbed::meshing
