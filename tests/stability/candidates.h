// Laws that might leave no body of coupled springs inside out, beside the one that is shipped.
#pragma once

#include <Eigen/LU>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "massspring/kernels/patch_law.h"
#include "tests/stability/stability.h"

namespace testbed::massspring {

/// An energy of det F and its derivatives (Pa).
struct OfVolume {
  double value, first, second;
};
using VolumeLaw = std::function<OfVolume(double J, double lambda, double mu)>;

/// g(J) of [(12)], expanded to second order below J_0.
inline OfVolume expanded(double J, double lambda, double mu, double J_0) {
  const double c = mu + lambda / 2, j = std::max(J, J_0), d = J - j;
  const OfVolume at{lambda / 4 * (j * j - 1) - c * std::log(j), lambda / 2 * j - c / j,
                    lambda / 2 + c / (j * j)};
  return {at.value + (at.first + at.second / 2 * d) * d, at.first + at.second * d, at.second};
}

/// What another J_0 adds to the law. With 1 a compressed patch obeys the law of Smith et al. 2018, without its
/// logarithm.
inline VolumeLaw other_expansion(double J_0) {
  return [=](double J, double lambda, double mu) -> OfVolume {
    if (J >= std::max(J_0, kLeastJacobian)) return {0, 0, 0};
    const OfVolume a = expanded(J, lambda, mu, J_0), b = expanded(J, lambda, mu, kLeastJacobian);
    return {a.value - b.value, a.first - b.first, a.second - b.second};
  };
}

/// A penalty of `stiffness` mu below J_1.
inline VolumeLaw penalty(double J_1, double stiffness) {
  return [=](double J, double, double mu) -> OfVolume {
    const double d = std::min(J - J_1, 0.), k = stiffness * mu;
    return {k / 2 * d * d, k * d, d < 0 ? k : 0};
  };
}

/// sum V phi(det F) over patches.
class PatchVolumes : public SurfaceEnergy {
 public:
  PatchVolumes(TetSprings patches, Eigen::Matrix3Xd X, VolumeLaw law)
      : patches_(std::move(patches)), X_(std::move(X)), law_(std::move(law)) {}

  double energy(const Eigen::Matrix3Xd& x) const override {
    double sum = 0;
    for_each_active(
        x, [&](int p, const Eigen::Matrix3d&, const OfVolume& of) { sum += patches_.volume[p] * of.value; });
    return sum;
  }
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const override {
    for_each_active(x, [&](int p, const Eigen::Matrix3d& F, const OfVolume& of) {
      const Eigen::Matrix3d C = cofactor(F);
      for (int e = patches_.first[p]; e < patches_.first[p + 1]; ++e)
        f.col(patches_.node[e]) -= patches_.volume[p] * of.first * C * patches_.b(p, e);
    });
  }
  void add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const override {
    const bool is_exact = curvature == Curvature::Exact;
    for_each_active(x, [&](int p, const Eigen::Matrix3d& F, const OfVolume& of) {
      const Eigen::Matrix3d C = cofactor(F);
      const double V = patches_.volume[p], second = is_exact ? of.second : std::max(of.second, 0.);
      for (int r = patches_.first[p]; r < patches_.first[p + 1]; ++r)
        for (int e = r; e < patches_.first[p + 1]; ++e) {
          const Eigen::Vector3d b_r = patches_.b(p, r), b_e = patches_.b(p, e);
          Eigen::Matrix3d block = V * second * (C * b_r) * (C * b_e).transpose();
          if (is_exact) {
            const Eigen::Vector3d w = V * of.first * F * b_r.cross(b_e);
            Eigen::Matrix3d turn;
            turn << 0, -w[2], w[1], w[2], 0, -w[0], -w[1], w[0], 0;
            block -= turn;
          }
          H.blocks.push_back({patches_.node[r], patches_.node[e], block});
        }
    });
  }

 private:
  static Eigen::Matrix3d cofactor(const Eigen::Matrix3d& F) {
    Eigen::Matrix3d C;
    for (int k = 0; k < 3; ++k) C.col(k) = F.col((k + 1) % 3).cross(F.col((k + 2) % 3));
    return C;
  }
  template <class Visit>
  void for_each_active(const Eigen::Matrix3Xd& x, const Visit& visit) const {
    for (int p = 0; p < patches_.n_patches(); ++p) {
      Eigen::Matrix3d F = Eigen::Matrix3d::Identity();
      for (int e = patches_.first[p]; e < patches_.first[p + 1]; ++e) {
        const int i = patches_.node[e];
        F += (x.col(i) - X_.col(i)) * patches_.b(p, e).transpose();
      }
      const OfVolume of = law_(F.determinant(), patches_.lambda[p], patches_.mu);
      if (of.first != 0 || of.second != 0) visit(p, F, of);
    }
  }

  TetSprings patches_;
  Eigen::Matrix3Xd X_;
  VolumeLaw law_;
};

struct Candidate {
  std::string name;
  double tetrahedra = 0;         ///< share taken from a blend's edges
  VolumeLaw of_patches = {};     ///< added to the law
  VolumeLaw of_tetrahedra = {};  ///< added for single tetrahedra where patches are larger
};

inline const std::vector<Candidate>& candidates() {
  static const std::vector<Candidate> kAll{
      {"as shipped"},
      {"J_0 = 1 [Smith et al. 2018]", 0, other_expansion(1)},
      {"J_0 = 0.3", 0, other_expansion(0.3)},
      {"J_0 = 0.03", 0, other_expansion(0.03)},
      {"J_0 = 0.01", 0, other_expansion(0.01)},
      {"J_0 = 0.003", 0, other_expansion(0.003)},
      {"a tenth of tetrahedra", 0.1},
      {"a penalty on tetrahedra below 0.2", 0, {}, penalty(0.2, 150)},
      {"a penalty on tetrahedra below 0.1, J_0 = 0.01", 0, other_expansion(0.01), penalty(0.1, 1000)},
  };
  return kAll;
}

inline Change change_of(const Candidate& candidate) {
  return [&candidate](MassSpringModel& model, Forces& forces) {
    const Eigen::Matrix3Xd& X = model.network.X;
    const Lame lame = lame_of(model.material);
    const bool is_averaged = model.tet_springs->n_patches() != model.network.T.cols();
    if (is_averaged && candidate.tetrahedra > 0) {
      Blend blend = kNodeAveraged;
      blend.tetrahedra = candidate.tetrahedra;
      blend.edges -= candidate.tetrahedra;
      model.tet_springs = couple_springs(X, model.network.T, lame, blend);
    }
    if (candidate.of_patches)
      forces.surface.push_back(std::make_shared<PatchVolumes>(*model.tet_springs, X, candidate.of_patches));
    if (candidate.of_tetrahedra)
      forces.surface.push_back(std::make_shared<PatchVolumes>(
          couple_springs(X, model.network.T, lame, kEdgeCoupled), X, candidate.of_tetrahedra));
  };
}

}  // namespace testbed::massspring
