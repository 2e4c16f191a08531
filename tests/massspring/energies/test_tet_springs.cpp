#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "massspring/energies/tet_springs.h"
#include "tests/massspring/dense.h"
#include "tests/meshing/box_tets.h"
#include "tests/meshing/flat_tetrahedra.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

constexpr double kRounding = 1e-10;  // sums of some 1e3 terms in double precision, with room
const Lame kSoft{2.0, 1.0};

Matrix3Xd random_field(Eigen::Index n, double size, std::uint64_t seed) {
  Random random(seed);
  Matrix3Xd u(3, n);
  for (double& c : u.reshaped()) c = size * (2 * random.uniform() - 1);
  return u;
}

Matrix3d some_rotation() {
  return Eigen::AngleAxisd(2.1, Vector3d(1, -2, 0.5).normalized()).toRotationMatrix();
}

/// psi(F) for det F > 0.1 (J/m3).
double soft_energy_density(const Matrix3d& F) {
  const double J = F.determinant();
  return kSoft.mu / 2 * (F.squaredNorm() - 3) + kSoft.lambda / 4 * (J * J - 1) -
         (kSoft.mu + kSoft.lambda / 2) * std::log(J);
}

struct NamedBlend {
  const char* name;
  Blend blend;
  std::vector<int> constrained = {};
};

class EveryBlend : public testing::TestWithParam<NamedBlend> {
 protected:
  TetMesh mesh = box_tets(3, 2, 2, 0.5, 0.15);
  TetSprings springs = couple_springs(mesh.X, mesh.T, kSoft, GetParam().blend, GetParam().constrained);
  const Eigen::VectorXd no_scale;
  /// Of each patch, half as large to half again as large.
  const Eigen::VectorXd scales = Eigen::VectorXd::Ones(springs.n_patches()) +
                                 random_field(springs.n_patches(), 0.5, 6).row(0).transpose();
  Matrix3Xd force_at(const Matrix3Xd& x, const Eigen::VectorXd& scale = {}) const {
    Matrix3Xd f = Matrix3Xd::Zero(3, x.cols());
    add_forces(springs, x - mesh.X, f, scale);
    return f;
  }
  double energy_at(const Matrix3Xd& x, const Eigen::VectorXd& scale = {}) const {
    return energy(springs, x - mesh.X, scale);
  }
};
INSTANTIATE_TEST_SUITE_P(TetSprings, EveryBlend,
                         testing::Values(NamedBlend{"EdgeCoupled", kEdgeCoupled},
                                         NamedBlend{"NodeAveraged", kNodeAveraged},
                                         NamedBlend{"NodeAveragedNearConstrainedNodes", kNodeAveraged, {0}},
                                         NamedBlend{"ThreeKinds", Blend{0.3, 0.3, 0.4}}),
                         [](const auto& info) { return info.param.name; });

TEST_P(EveryBlend, ForceIsMinusEnergyGradientFromRestToInversion) {
  constexpr double h = 1e-6, kSlopeTolerance = 1e-6;  // central difference: h^2 and rounding / h
  for (double size : {0.01, 0.1, 0.6}) {              // the last one inverts tetrahedra
    const Matrix3Xd x = mesh.X + random_field(mesh.X.cols(), size, 3);
    for (const Eigen::VectorXd& scale : {no_scale, scales}) {
      const Matrix3Xd f = force_at(x, scale);
      ASSERT_GT(f.norm(), 1e-3);
      for (Eigen::Index c = 0; c < x.size(); c += 7) {
        Matrix3Xd ahead = x, behind = x;
        ahead(c) += h;
        behind(c) -= h;
        const double slope = (energy_at(ahead, scale) - energy_at(behind, scale)) / (2 * h);
        EXPECT_NEAR(-slope, f(c), kSlopeTolerance * f.norm());
      }
    }
  }
}

TEST_P(EveryBlend, HessianIsForceDifferenceNearRest) {
  // Stretched a little, where nothing is projected away.
  constexpr double h = 1e-6, kDifferenceTolerance = 1e-6;
  const Matrix3Xd x = 1.05 * mesh.X, p = random_field(x.cols(), 1, 5);
  BlockMatrix K = make_block_matrix(static_cast<int>(x.cols()), pairs_of(springs));
  add_hessian(springs, x - mesh.X, K);
  mirror(K);
  Matrix3Xd product;
  multiply(K, p, product);
  const Matrix3Xd difference = (force_at(x - h * p) - force_at(x + h * p)) / (2 * h);
  ASSERT_GT(product.norm(), 1);
  EXPECT_LT((product - difference).norm(), kDifferenceTolerance * product.norm());
}

TEST_P(EveryBlend, ExactHessianIsForceDifferenceWhereItIsIndefinite) {
  constexpr double h = 1e-6, kDifferenceTolerance = 1e-5;
  const Matrix3Xd x = 0.7 * mesh.X + random_field(mesh.X.cols(), 0.1, 2), p = random_field(x.cols(), 1, 5);
  for (const Eigen::VectorXd& scale : {no_scale, scales}) {
    BlockMatrix exact = make_block_matrix(static_cast<int>(x.cols()), pairs_of(springs)), projected = exact;
    add_hessian(springs, x - mesh.X, exact, Curvature::Exact, scale);
    mirror(exact);
    add_hessian(springs, x - mesh.X, projected, Curvature::Projected, scale);
    mirror(projected);
    Matrix3Xd product, projected_product;
    multiply(exact, p, product);
    multiply(projected, p, projected_product);
    const Matrix3Xd difference = (force_at(x - h * p, scale) - force_at(x + h * p, scale)) / (2 * h);
    EXPECT_LT((product - difference).norm(), kDifferenceTolerance * product.norm());
    EXPECT_GT((projected_product - difference).norm(), 1e-2 * product.norm());
  }
}

TEST_P(EveryBlend, HessianIsAddedToWhatIsThere) {
  const Matrix3Xd x = mesh.X + random_field(mesh.X.cols(), 0.1, 2);
  BlockMatrix K = make_block_matrix(static_cast<int>(x.cols()), pairs_of(springs));
  add_hessian(springs, x - mesh.X, K);
  mirror(K);
  const Eigen::MatrixXd once = dense(K);
  add_hessian(springs, x - mesh.X, K);
  mirror(K);
  EXPECT_LT((dense(K) - 2 * once).norm(), kRounding * once.norm());
  EXPECT_LT((once - once.transpose()).norm(), kRounding * once.norm());
}

// The same springs in another order have the same Hessian, whichever of the two a matrix has met before.
TEST_P(EveryBlend, HessiansOfTwoSetsOfSpringsAddUpInOneMatrix) {
  const Matrix3Xd u = random_field(mesh.X.cols(), 0.1, 2);
  const TetSprings reversed =
      couple_springs(mesh.X, mesh.T.rowwise().reverse(), kSoft, GetParam().blend, GetParam().constrained);
  BlockMatrix K = make_block_matrix(static_cast<int>(u.cols()), pairs_of(springs));
  add_hessian(springs, u, K);
  mirror(K);
  const Eigen::MatrixXd once = dense(K);
  add_hessian(reversed, u, K);
  mirror(K);
  EXPECT_LT((dense(K) - 2 * once).norm(), kRounding * once.norm());
}

TEST_P(EveryBlend, RestIsFreeOfForceAtAnyRotation) {
  const Matrix3Xd moved = (some_rotation() * mesh.X).colwise() + Vector3d(3, 4, 5);
  const double scale = force_at(1.1 * mesh.X).norm();
  EXPECT_LT(force_at(moved).norm(), kRounding * scale);
  EXPECT_NEAR(energy_at(moved), 0, kRounding);
}

TEST_P(EveryBlend, RotationTurnsForcesWithIt) {
  const Matrix3Xd x = mesh.X + random_field(mesh.X.cols(), 0.1, 9);
  const Matrix3Xd f = force_at(x), turned = force_at(some_rotation() * x);
  ASSERT_GT(f.norm(), 1e-2);
  EXPECT_LT((turned - some_rotation() * f).norm(), kRounding * f.norm());
}

TEST_P(EveryBlend, AffineStretchHasTheContinuumsEnergy) {
  const Matrix3d F = (Matrix3d() << 1.3, 0.2, 0, 0, 0.8, 0.1, 0, 0, 1.1).finished();
  const double V = lumped_mass(mesh.X, mesh.T, 1).sum();
  EXPECT_NEAR(energy_at(F * mesh.X), V * soft_energy_density(F), kRounding * V);
}

// The patch test, without which no refinement converges.
TEST_P(EveryBlend, UniformStrainIsInBalanceWithin) {
  const Matrix3d F = (Matrix3d() << 1.3, 0.2, 0, 0, 0.8, 0.1, 0, 0, 1.1).finished();
  const Matrix3Xd f = force_at(F * mesh.X);
  int n_within = 0;
  for (Eigen::Index i = 0; i < mesh.X.cols(); ++i) {
    const Vector3d X = mesh.X.col(i);
    if ((X.array() < 0.2).any() || (X.array() > Eigen::Array3d(1.3, 0.8, 0.8)).any()) continue;
    ++n_within;
    EXPECT_LT(f.col(i).norm(), kRounding * f.norm()) << "node " << i;
  }
  EXPECT_EQ(n_within, 2);
}

TEST_P(EveryBlend, ACollapsedBodysEnergyIsThatOfALikeOneOfTheCubeOfItsScale) {
  const Eigen::Index n = springs.n_patches();
  const Matrix3Xd x = mesh.X + random_field(mesh.X.cols(), 0.1, 9);
  ASSERT_GT(energy_at(x), 1e-2);
  for (double s : {0.3, 0.7, 1.6}) {
    const Eigen::VectorXd scale = Eigen::VectorXd::Constant(n, s);
    EXPECT_NEAR(energy_at(s * mesh.X, scale), 0, kRounding) << "the shape that it collapsed to";
    EXPECT_NEAR(energy_at(s * x, scale), s * s * s * energy_at(x), kRounding);
  }
}

TEST_P(EveryBlend, CrushedBodyHasTheSecondOrderExpansionOfTheEnergyOfItsVolume) {
  const double V = lumped_mass(mesh.X, mesh.T, 1).sum();
  for (double J : {0.11, 0.09, 0.02, -0.3}) {
    constexpr double kJ0 = 0.1;
    const Matrix3d F = Vector3d(1, 1, J).asDiagonal(), F_0 = Vector3d(1, 1, kJ0).asDiagonal();
    const double by_length = kSoft.mu / 2 * (J * J - kJ0 * kJ0), c = kSoft.mu + kSoft.lambda / 2;
    const double expansion = soft_energy_density(F_0) + by_length +
                             (kSoft.lambda / 2 * kJ0 - c / kJ0) * (J - kJ0) +
                             (kSoft.lambda / 2 + c / (kJ0 * kJ0)) / 2 * (J - kJ0) * (J - kJ0);
    const double expected = V * (J > kJ0 ? soft_energy_density(F) : expansion);
    EXPECT_NEAR(energy_at(F * mesh.X), expected, kRounding * expected) << "J " << J;
    EXPECT_NEAR(smallest_jacobian(springs, F * mesh.X - mesh.X), J, kRounding);
  }
}

TEST_P(EveryBlend, MirrorImageIsPushedBack) {
  Matrix3Xd mirrored = mesh.X;
  mirrored.row(0) *= -1;
  EXPECT_LT(smallest_jacobian(springs, mirrored - mesh.X), 0);
  const Matrix3Xd flatter = mirrored.array().colwise() * Vector3d(0.99, 1, 1).array();
  EXPECT_LT(energy_at(flatter), energy_at(mirrored));
}

TEST_P(EveryBlend, PressureOnlyGrowsUnderCompression) {
  double before = 0;
  for (double stretch = 0.99; stretch > 0.2; stretch -= 0.01) {  // down to volume 1 %
    const double h = 1e-5;
    const double work = energy_at((stretch - h) * mesh.X) - energy_at((stretch + h) * mesh.X);
    const double pressure = work / (std::pow(stretch + h, 3) - std::pow(stretch - h, 3));
    EXPECT_GT(pressure, before) << "stretch " << stretch;
    before = pressure;
  }
}

TEST_P(EveryBlend, NodeOrderDoesNotMatter) {
  const Eigen::Index n = mesh.X.cols();
  Eigen::PermutationMatrix<Eigen::Dynamic> order(n);
  order.setIdentity();
  Random random(4);
  for (Eigen::Index i = n - 1; i > 0; --i)
    std::swap(order.indices()[i], order.indices()[static_cast<int>(random.uniform() * (i + 1))]);
  TetMesh permuted = mesh;
  permuted.X = mesh.X * order.transpose();  // node i becomes node order(i)
  for (int& i : permuted.T.reshaped()) i = order.indices()[i];
  std::vector<int> constrained = GetParam().constrained;
  for (int& i : constrained) i = order.indices()[i];
  const TetSprings again = couple_springs(permuted.X, permuted.T, kSoft, GetParam().blend, constrained);
  const Matrix3Xd x = mesh.X + random_field(n, 0.1, 9), f = force_at(x);
  Matrix3Xd f_again = Matrix3Xd::Zero(3, n);
  add_forces(again, (x - mesh.X) * order.transpose(), f_again);
  EXPECT_LT((f_again * order - f).norm(), kRounding * f.norm());
}

using Matrix9d = Eigen::Matrix<double, 9, 9>;

/// psi'' at F over its columns: of one tetrahedron whose nodes are displaced by F's columns, a fourth one
/// staying.
Matrix9d second_derivative(const Matrix3d& F, const Lame& lame, Curvature curvature) {
  Matrix3Xd X = Matrix3Xd::Zero(3, 4), x = X;
  X.leftCols<3>().setIdentity();
  x.leftCols<3>() = F;
  const TetSprings patch = couple_springs(X, Eigen::Vector4i(3, 0, 1, 2), lame, kEdgeCoupled);
  BlockMatrix K = make_block_matrix(4, pairs_of(patch));
  add_hessian(patch, x - X, K, curvature);
  mirror(K);
  return dense(K).topLeftCorner<9, 9>() / patch.volume[0];
}

TEST(TetSprings, ProjectionSetsNegativeEigenvaluesToZeroHoweverCrushed) {
  constexpr double kProjectionTolerance = 1e-12;  // rounding
  const Matrix3d R = some_rotation(), Q = R * R.transpose().col(0).asDiagonal() * R;
  const Matrix3d flat = Vector3d(1, -2, 3) * Vector3d(2, 0.3, 1).transpose();
  std::vector<Matrix3d> cases{Matrix3d::Identity(), R, 0.5 * R, Matrix3d::Zero(), flat, 1e-9 * flat, -R};
  for (double first : {1., 1 + 1e-9, 0.6, 1e-3, 3.})
    for (double second : {1., 1 - 1e-12, 0.1, 1e-8, 0.})
      for (double third : {1., 0.3, 1e-5, 1e-12, 0., -1e-7, -0.3, -1.})
        for (const Matrix3d& V : {R, Matrix3d(Matrix3d::Identity()), Q})
          cases.push_back(R * R * Vector3d(first, second, third).asDiagonal() * V.transpose());
  for (std::uint64_t seed = 0; seed < 100; ++seed)
    for (double size : {1e-3, 1., 10.}) cases.push_back(Matrix3d::Identity() + random_field(3, size, seed));
  int n_indefinite = 0;
  for (const Matrix3d& F : cases)
    for (const Lame& lame : {kSoft, Lame{50, 1}, Lame{0, 1}}) {
      const Matrix9d exact = second_derivative(F, lame, Curvature::Exact);
      const Eigen::SelfAdjointEigenSolver<Matrix9d> eigen(exact);
      const Matrix9d expected = eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0).asDiagonal() *
                                eigen.eigenvectors().transpose();
      n_indefinite += eigen.eigenvalues()[0] < -kProjectionTolerance * exact.norm();
      ASSERT_LT((second_derivative(F, lame, Curvature::Projected) - expected).norm(),
                kProjectionTolerance * exact.norm())
          << F << "\nlambda " << lame.lambda;
    }
  EXPECT_GT(n_indefinite, 500);
}

TEST(TetSprings, SmallestJacobianIsThatOfTheMostCrushedPatch) {
  const TetMesh mesh = box_tets(2, 2, 2, 1);
  const TetSprings springs = couple_springs(mesh.X, mesh.T, kSoft, kEdgeCoupled);
  EXPECT_NEAR(smallest_jacobian(springs, 0 * mesh.X), 1, kRounding);
  EXPECT_NEAR(smallest_jacobian(springs, 0.2 * mesh.X), 1.2 * 1.2 * 1.2, kRounding) << "swollen";
  Matrix3Xd x = mesh.X;
  x(0, 2) -= 0.75;  // a corner, where it leaves both its tetrahedra a quarter of their height along x
  EXPECT_NEAR(smallest_jacobian(springs, x - mesh.X), 0.25, kRounding);
}

TEST(TetSprings, EnergyIsThatOfSquaredLengthsAmongThePatch) {
  const TetMesh mesh = box_tets(2, 2, 2, 1, 0.2);
  const TetSprings springs = couple_springs(mesh.X, mesh.T, kSoft, kNodeAveraged);
  const Matrix3Xd x = mesh.X + random_field(mesh.X.cols(), 0.1, 3);
  for (int p = 0; p < springs.n_patches(); p += 10) {
    Matrix3d F = Matrix3d::Zero(), C = Matrix3d::Zero();
    for (int e = springs.first[p]; e < springs.first[p + 1]; ++e) {
      F += x.col(springs.node[e]) * springs.b(p, e).transpose();
      for (int r = springs.first[p]; r < springs.first[p + 1]; ++r)
        C -= (x.col(springs.node[e]) - x.col(springs.node[r])).squaredNorm() / 2 * springs.b(p, e) *
             springs.b(p, r).transpose();
    }
    EXPECT_LT((F.transpose() * F - C).norm(), kRounding);
  }
}

TEST(StiffnessOfTetrahedra, IsTheHessianOfSingleOnesAtRest) {
  TetMesh mesh = box_tets(3, 2, 2, 0.5, 0.15);
  mesh.X.conservativeResize(3, mesh.X.cols() + 1);  // a node of no tetrahedron
  mesh.X.rightCols(1).setZero();
  const auto n = static_cast<int>(mesh.X.cols());
  const TetSprings single = couple_springs(mesh.X, mesh.T, kSoft, kEdgeCoupled);
  BlockMatrix expected = make_block_matrix(n, pairs_of(single));
  add_hessian(single, Matrix3Xd::Zero(3, n), expected);
  mirror(expected);
  const BlockMatrix K =
      stiffness_of_tetrahedra(mesh.X, mesh.T, kSoft, Eigen::RowVectorXd::Ones(mesh.T.cols()));
  EXPECT_EQ(K.row_start, expected.row_start);
  EXPECT_EQ(K.column, expected.column);
  EXPECT_EQ(K.diagonal, expected.diagonal);
  EXPECT_LT((dense(K) - dense(expected)).norm(), kRounding * dense(expected).norm());
}

TEST(PartsLeftByAverages, AreThoseOfVolumesAroundEdgesByBruteForce) {
  TetMesh mesh = box_tets(3, 2, 2, 0.5, 0.15);
  meshing::add_flat_tetrahedra(mesh, 1e-3);
  const auto has = [&](Eigen::Index t, int node) { return (mesh.T.col(t).array() == node).any(); };
  const Eigen::RowVectorXd parts = parts_left_by_averages(mesh.X, mesh.T);
  ASSERT_EQ(parts.size(), mesh.T.cols());
  for (Eigen::Index t = 0; t < mesh.T.cols(); ++t) {
    double left = 0;  // of the energy of a strain of 1 in t
    for (int i = 0; i < 4; ++i)
      for (int j = i + 1; j < 4; ++j) {
        double around = 0;
        for (Eigen::Index s = 0; s < mesh.T.cols(); ++s)
          if (has(s, mesh.T(i, t)) && has(s, mesh.T(j, t))) around += tet_volume(mesh.X, mesh.T.col(s)) / 6;
        const double share = tet_volume(mesh.X, mesh.T.col(t)) / 6;
        left += share * share / around;
      }
    left /= tet_volume(mesh.X, mesh.T.col(t));
    EXPECT_NEAR(parts[t], std::min(1., 5 * left), kRounding);
  }
  EXPECT_LT(parts.minCoeff(), 1e-2);
}

TEST(SingleTetrahedra, OfAPartHaveThatPartOfTheEnergyAndStiffness) {
  const TetMesh mesh = box_tets(2, 1, 1, 1, 0.2);
  const Eigen::RowVectorXd ones = Eigen::RowVectorXd::Ones(mesh.T.cols());
  Eigen::RowVectorXd parts = 0.25 * ones;
  const double whole = energy(couple_springs(mesh.X, mesh.T, kSoft, kEdgeCoupled), 0.1 * mesh.X);
  EXPECT_NEAR(energy(single_tetrahedra(mesh.X, mesh.T, kSoft, parts), 0.1 * mesh.X), whole / 4,
              kRounding * whole);
  parts[3] = 1;
  Matrix3Xd moved = Matrix3Xd::Zero(3, mesh.X.cols());
  moved.col(mesh.T(0, 3)).setOnes();
  const TetSprings single = single_tetrahedra(mesh.X, mesh.T, kSoft, parts);
  Matrix3Xd forces = Matrix3Xd::Zero(3, mesh.X.cols()), Ku;
  add_linear_forces(single, moved, forces);
  multiply(stiffness_of_tetrahedra(mesh.X, mesh.T, kSoft, parts), moved, Ku);
  EXPECT_LT((forces + Ku).norm(), kRounding * Ku.norm());
}

TEST(CoupleSprings, ANodeOfNoTetrahedronHasNoEnergy) {
  const TetMesh mesh = box_tets(2, 1, 1, 1, 0.2);
  TetMesh lonely = mesh;
  const int node = 1;  // between others, so that its patch is empty
  lonely.X.resize(3, mesh.X.cols() + 1);
  lonely.X << mesh.X.leftCols(node), Eigen::Vector3d(5, 5, 5), mesh.X.rightCols(mesh.X.cols() - node);
  for (int& i : lonely.T.reshaped()) i += i >= node;
  const auto energy_of = [](const TetMesh& body) {
    return energy(couple_springs(body.X, body.T, kSoft, kNodeAveraged), 0.1 * body.X);
  };
  EXPECT_NEAR(energy_of(lonely), energy_of(mesh), kRounding * energy_of(mesh));
}

TEST(CoupleSprings, AveragedGradientsByBruteForce) {
  const TetMesh mesh = box_tets(4, 2, 1, 1, 0.2);
  const Blend blend{0, 0.6, 0.4};
  const int constrained = 0;
  const TetSprings springs = couple_springs(mesh.X, mesh.T, kSoft, blend, {constrained});
  const auto part = [&](int node) {
    for (const auto& t : mesh.T.colwise())
      if ((t.array() == constrained).any() && (t.array() == node).any()) return kConstrainedNodes;
    return blend.nodes;
  };
  const Matrix3Xd x = mesh.X + random_field(mesh.X.cols(), 0.3, 3);
  std::vector<std::vector<int>>
      corners;  // of each patch: the two ends of an edge, ascending, then single nodes
  for (int i = 0; i < mesh.X.cols(); ++i)
    for (int j = i + 1; j < mesh.X.cols(); ++j)
      for (const auto& t : mesh.T.colwise())
        if ((t.array() == i).any() && (t.array() == j).any()) {
          corners.push_back({i, j});
          break;
        }
  for (int i = 0; i < mesh.X.cols(); ++i) corners.push_back({i});
  ASSERT_EQ(static_cast<int>(corners.size()), springs.n_patches());

  for (int p = 0; p < springs.n_patches(); ++p) {
    Matrix3d sum = Matrix3d::Zero();
    double weights = 0;
    for (const auto& t : mesh.T.colwise()) {
      if (!std::all_of(corners[p].begin(), corners[p].end(), [&](int i) { return (t.array() == i).any(); }))
        continue;
      Matrix3d rest, now;
      for (int k = 0; k < 3; ++k) {
        rest.col(k) = mesh.X.col(t[k + 1]) - mesh.X.col(t[0]);
        now.col(k) = x.col(t[k + 1]) - x.col(t[0]);
      }
      const double nodes = (part(t[0]) + part(t[1]) + part(t[2]) + part(t[3])) / 4;
      const double of_volume = corners[p].size() == 2 ? (1 - nodes) / 6 : part(corners[p][0]) / 4;
      const double weight = of_volume * rest.determinant() / 6;
      sum += weight * now * rest.inverse();
      weights += weight;
    }
    Matrix3d F = Matrix3d::Zero();
    for (int e = springs.first[p]; e < springs.first[p + 1]; ++e)
      F += x.col(springs.node[e]) * springs.b(p, e).transpose();
    EXPECT_NEAR(springs.volume[p], weights, kRounding);
    EXPECT_LT((F - sum / weights).norm(), kRounding);
  }
}

TEST(LumpedMass, TotalIsExact) {
  const TetMesh mesh = box_tets(4, 3, 2, 0.5);
  EXPECT_NEAR(lumped_mass(mesh.X, mesh.T, 1000).sum(), 1000 * 4 * 3 * 2 * 0.125, 1e-9);
}

TEST(LameOf, RefusesWhatTheModelCannotBe) {
  EXPECT_THROW(lame_of({1e5, 0.5, 1000, 0}), std::runtime_error);
  EXPECT_THROW(lame_of({1e5, -0.1, 1000, 0}), std::runtime_error);
  EXPECT_THROW(lame_of({0, 0.3, 1000, 0}), std::runtime_error);
  EXPECT_NEAR(lame_of({2.5, 0.25, 1000, 0}).lambda, 1, kRounding);
  EXPECT_NEAR(lame_of({2.5, 0.25, 1000, 0}).mu, 1, kRounding);
}

}  // namespace
}  // namespace testbed::massspring
