// Coupled springs against deal.II: at small strain they are linear elements.
#include <gtest/gtest.h>

#include "fem_reference/solid/elasticity.h"
#include "massspring/energies/tet_springs.h"
#include "tests/massspring/dense.h"
#include "tests/meshing/box_tets.h"

namespace testbed::fem {
namespace {

using namespace massspring;

/// The springs' stiffness at rest, components 3 node + c.
Eigen::MatrixXd stiffness_of(const TetMesh& mesh, const Material& material, const Blend& blend) {
  const TetSprings springs = couple_springs(mesh.X, mesh.T, lame_of(material), blend);
  BlockMatrix K = make_block_matrix(static_cast<int>(mesh.X.cols()), pairs_of(springs));
  add_hessian(springs, 0 * mesh.X, K);
  mirror(K);
  return dense(K);
}

class EdgeCoupled : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Nu, EdgeCoupled, testing::Values(0., 0.25, 0.3, 0.45, 0.499));

TEST_P(EdgeCoupled, HasTheStiffnessOfLinearElements) {
  constexpr double kRounding = 1e-10;  // of the largest entry
  const TetMesh mesh = box_tets(3, 2, 2, 0.4, 0.25);
  const Material material{1e5, GetParam(), 1000, 0};
  ElasticSolid solid(mesh, 1);
  solid.assemble(material, ElasticLaw::SmallStrain, {}, {});
  const Eigen::MatrixXd expected = solid.stiffness();
  const double largest = expected.cwiseAbs().maxCoeff();
  ASSERT_GT(largest, 1e4);
  EXPECT_LT((stiffness_of(mesh, material, kEdgeCoupled) - expected).cwiseAbs().maxCoeff(),
            kRounding * largest);
  EXPECT_GT((stiffness_of(mesh, material, kNodeAveraged) - expected).cwiseAbs().maxCoeff(), 0.01 * largest)
      << "averaged strain is another model";
}

}  // namespace
}  // namespace testbed::fem
