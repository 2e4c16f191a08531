#include "massspring/statics/exact_fields.h"

#include <Eigen/Dense>
#include <cmath>
#include <stdexcept>

#include "meshing/algebra/rigid_motion.h"
#include "meshing/surface/surface.h"

namespace testbed::massspring {

namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

}  // namespace

const std::vector<std::string>& exact_field_names() {
  static const std::vector<std::string> kNames{"pressure", "uniaxial", "shear",
                                               "bending",  "torsion",  "cubic_harmonic"};
  return kNames;
}

ExactField exact_field(const std::string& name, const Lame& lame, const Vector3d& centre) {
  const auto [lambda, mu] = lame;
  const double nu = lambda / (2 * (lambda + mu));
  std::function<Vector3d(const Vector3d&)> u;
  std::function<Matrix3d(const Vector3d&)> gradient;  // of u at x - centre
  const auto linear = [&](const Matrix3d& G) {
    u = [G](const Vector3d& x) -> Vector3d { return G * x; };
    gradient = [G](const Vector3d&) { return G; };
  };
  if (name == "pressure") {
    linear(-Matrix3d::Identity());
  } else if (name == "uniaxial") {
    linear(Vector3d(1, -nu, -nu).asDiagonal());
  } else if (name == "shear") {
    linear((Matrix3d() << 0, 1, 0, 1, 0, 0, 0, 0, 0).finished());
  } else if (name == "bending") {
    u = [nu](const Vector3d& x) {
      return Vector3d(x[0] * x[2], -nu * x[1] * x[2],
                      -(x[0] * x[0] + nu * x[2] * x[2] - nu * x[1] * x[1]) / 2);
    };
    gradient = [nu](const Vector3d& x) {
      return (Matrix3d() << x[2], 0, x[0], 0, -nu * x[2], -nu * x[1], -x[0], nu * x[1], -nu * x[2])
          .finished();
    };
  } else if (name == "torsion") {
    u = [](const Vector3d& x) { return Vector3d(-x[1] * x[2], x[0] * x[2], 0); };
    gradient = [](const Vector3d& x) {
      return (Matrix3d() << 0, -x[2], -x[1], x[2], 0, x[0], 0, 0, 0).finished();
    };
  } else if (name == "cubic_harmonic") {  // u = grad(x^3 - 3 x y^2 + 3 y z^2 - y^3) / 6
    u = [](const Vector3d& x) -> Vector3d {
      return Vector3d(x[0] * x[0] - x[1] * x[1], -2 * x[0] * x[1] + x[2] * x[2] - x[1] * x[1],
                      2 * x[1] * x[2]) /
             2;
    };
    gradient = [](const Vector3d& x) {
      return (Matrix3d() << x[0], -x[1], 0, -x[1], -x[0] - x[1], x[2], 0, x[2], x[1]).finished();
    };
  } else {
    throw std::runtime_error("unknown exact field '" + name + "'");
  }
  return {[=](const Vector3d& x) { return u(x - centre); },
          [=](const Vector3d& x) -> Matrix3d {
            const Matrix3d G = gradient(x - centre);
            return lambda * G.trace() * Matrix3d::Identity() + mu * (G + G.transpose());
          }};
}

Matrix3Xd displacements(const ExactField& field, const Matrix3Xd& X) {
  Matrix3Xd u(3, X.cols());
  for (Eigen::Index i = 0; i < X.cols(); ++i) u.col(i) = field.displacement(X.col(i));
  return u;
}

SurfaceError surface_error(const Matrix3Xd& u, const Matrix3Xd& exact, const Matrix3Xd& X,
                           const Eigen::Matrix3Xi& F) {
  const Eigen::Index n = F.maxCoeff() + 1;
  const Eigen::VectorXd areas = vertex_areas(X, F).head(n);
  const Matrix3Xd difference = without_rigid_motion(u.leftCols(n) - exact.leftCols(n), X.leftCols(n), areas);
  const Matrix3Xd reference = without_rigid_motion(exact.leftCols(n), X.leftCols(n), areas);
  const auto l2 = [&](const Matrix3Xd& v) { return std::sqrt(v.colwise().squaredNorm().dot(areas)); };
  return {l2(difference) / l2(reference),
          difference.colwise().norm().maxCoeff() / reference.colwise().norm().maxCoeff()};
}

Eigen::VectorXd node_errors(const Matrix3Xd& u, const Matrix3Xd& exact, const Matrix3Xd& X) {
  const Eigen::VectorXd equal = Eigen::VectorXd::Ones(X.cols());
  const double largest = without_rigid_motion(exact, X, equal).colwise().norm().maxCoeff();
  return without_rigid_motion(u - exact, X, equal).colwise().norm().transpose() / largest;
}

}  // namespace testbed::massspring
