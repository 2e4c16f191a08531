#include "massspring/energies/tractions.h"

#include "meshing/surface/surface.h"

namespace testbed::massspring {

Eigen::Matrix3Xd traction_forces(const std::function<Eigen::Matrix3d(const Eigen::Vector3d&)>& stress,
                                 const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F) {
  struct Orbit {  // three points with two equal barycentric coordinates, of degree 4 [Dunavant 1985]
    double weight, equal;
  };
  constexpr Orbit kRule[] = {{0.109951743655322, 0.091576213509771}, {0.223381589678011, 0.445948490915965}};
  const Eigen::Matrix3Xd areas = area_vectors(X, F);
  Eigen::Matrix3Xd f = Eigen::Matrix3Xd::Zero(3, X.cols());
  for (int t = 0; t < F.cols(); ++t)
    for (const auto& [weight, equal] : kRule)
      for (int k = 0; k < 3; ++k) {
        Eigen::Vector3d l = Eigen::Vector3d::Constant(equal);
        l(k) = 1 - 2 * equal;
        const Eigen::Vector3d force = weight * stress(X(Eigen::all, F.col(t)) * l) * areas.col(t);
        f(Eigen::all, F.col(t)) += force * l.transpose();
      }
  return f;
}

}  // namespace testbed::massspring
