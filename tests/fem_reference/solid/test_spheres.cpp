// Balls and hollow balls against exact solutions, the faceting of their surface extrapolated away.
#include <gtest/gtest.h>

#include <cmath>

#include "fem_reference/solid/elasticity.h"
#include "fem_reference/solid/natural_modes.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/tetrahedra/tetrahedralize.h"
#include "tests/fem_reference/root.h"
#include "tests/meshing/surfaces.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

/// Lowest torsional and spheroidal frequency of degree 2 of a free ball of radius 1 [Lamb 1882] (Hz).
std::pair<double, double> lamb(const Material& m) {
  const double mu = m.E / (2 * (1 + m.nu)), shear_speed = std::sqrt(mu / m.rho),
               ratio = std::sqrt((1 - 2 * m.nu) / (2 - 2 * m.nu));  // of shear to pressure wave speed
  const auto j = [](unsigned n, double x) { return std::sph_bessel(n, x); };
  const double torsional = root([&](double x) { return x * j(3, x) - j(2, x); }, 1, 3.5);
  const double spheroidal = root(
      [&](double x) {
        const double y = ratio * x, half = x * x / 2;
        return ((2 - half) * j(2, y) + 2 * y * j(3, y)) * ((3 - half) * j(2, x) + x * j(3, x)) -
               6 * (j(2, x) - x * j(3, x)) * (j(2, y) - y * j(3, y));
      },
      1.5, 3.2);
  return {torsional * shear_speed / (2 * M_PI), spheroidal * shear_speed / (2 * M_PI)};
}

/// Mean of the five frequencies from `first` on, which are one on a true ball.
double mean_of_five(const Modes& modes, int first) {
  return modes.frequency.segment<5>(first).mean();
}

// A polyhedron inscribed in the ball is smaller by the square of its edges, so a surface of half their length
// has a quarter of the error, and two of them tell the ball's own frequency.
TEST(Ball, VibratesAsLambSays) {
  const Material material{1000, 0.25, 1, 0};
  std::vector<Eigen::Vector2d> f;
  for (int n : {162, 642}) {
    ElasticSolid solid(tetrahedralize(make_shape("ball", n, {2, 2, 2})), 2);
    solid.assemble(material, ElasticLaw::SmallStrain, {}, {});
    const Modes modes = natural_modes(solid.stiffness(), solid.mass(), {}, 10);
    ASSERT_EQ(modes.n_rigid, 6);
    f.push_back({mean_of_five(modes, 0), mean_of_five(modes, 5)});
  }
  const auto [torsional, spheroidal] = lamb(material);
  const Eigen::Array2d exact(torsional, spheroidal), extrapolated = (4 * f[1] - f[0]) / 3;
  const Eigen::Array2d order = ((f[0].array() - exact) / (f[1].array() - exact)).log() / std::log(2);
  for (int k = 0; k < 2; ++k) {
    EXPECT_NEAR(order(k), 2, 0.15);
    EXPECT_NEAR(extrapolated(k) / exact(k), 1, 3e-4);  // 3e-3 on the finest surface itself
  }
}

// Thick-walled sphere of radii 1 and 2 under pressure p from within [Lame 1852]:
// u_r = p / (7 E) ((1 - 2 nu) r + 4 (1 + nu) / r^2).
TEST(HollowBall, WidensAsLameSays) {
  const Material material{1000, 0.3, 1, 0};
  constexpr double p = 1;
  std::vector<Eigen::Vector2d> u;  // inside and outside
  for (int n : {162, 642}) {
    const SurfaceMesh outer = make_shape("ball", n, {4, 4, 4}), inner = make_shape("ball", n, {2, 2, 2});
    const SurfaceMesh surface = join(outer, inside_out(inner));
    TetOptions options;  // as fine everywhere as on the inner surface: what is left is its faceting
    options.interior_size = 3.8 / std::sqrt(n);
    const TetMesh mesh = tetrahedralize(surface, options);
    ElasticLoads loads;
    const Matrix3Xd normals = area_vectors(mesh.X, mesh.F).colwise().normalized();
    loads.traction = [normals, first = static_cast<int>(outer.F.cols())](const Vector3d&, int f) -> Vector3d {
      return (f < first ? 0 : -p) * normals.col(f);
    };
    ElasticSolid solid(mesh, 2);
    solid.assemble(material, ElasticLaw::SmallStrain, loads, {});
    ASSERT_TRUE(solid.solve().is_converged);
    const Eigen::RowVectorXd radial = solid.displacement()
                                          .leftCols(surface.X.cols())
                                          .cwiseProduct(surface.X.colwise().normalized())
                                          .colwise()
                                          .sum();
    u.push_back({radial.tail(inner.X.cols()).mean(), radial.head(outer.X.cols()).mean()});
  }
  const auto lame = [&](double r) {
    return p / (7 * material.E) * ((1 - 2 * material.nu) * r + 4 * (1 + material.nu) / (r * r));
  };
  const Eigen::Array2d exact(lame(1), lame(2)), extrapolated = (4 * u[1] - u[0]) / 3;
  const Eigen::Array2d order = ((u[0].array() - exact) / (u[1].array() - exact)).log() / std::log(2);
  for (int k = 0; k < 2; ++k) {
    EXPECT_NEAR(order(k), 2, 0.15);
    EXPECT_NEAR(extrapolated(k) / exact(k), 1, 1e-3);
  }
}

}  // namespace
}  // namespace testbed::fem
