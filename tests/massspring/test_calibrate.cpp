#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "massspring/calibrate.h"
#include "massspring/calibrations/calibrations.h"
#include "massspring/diagnostics.h"
#include "tests/massspring/box_tets.h"

namespace testbed {
namespace {

constexpr double rounding = 1e-10;

SpringNetwork network_of(const TetMesh& mesh) {
  SpringNetwork network{mesh.X, mesh.F, {}, mesh.T, mesh.n_surface};
  std::vector<Eigen::Vector2i> pairs;
  for (const auto& t : mesh.T.colwise())
    for (int k = 0; k < 3; ++k) pairs.emplace_back(std::min(t[k], t[k + 1]), std::max(t[k], t[k + 1]));
  network.E.resize(2, pairs.size());
  for (std::size_t s = 0; s < pairs.size(); ++s) network.E.col(s) = pairs[s];
  return network;
}

Material material_of(double nu) {
  Material material;
  material.nu = nu;
  return material;
}

MassSpringModel model_of(const std::string& name, double nu = 0.25) {
  return calibrate(network_of(box_tets(4, 3, 3, 0.4, 0.2)), material_of(nu), find_calibration(name));
}

std::string refusal_of(const std::string& name, double nu) {
  try {
    model_of(name, nu);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

class EveryCalibration : public testing::TestWithParam<Calibration> {};
INSTANTIATE_TEST_SUITE_P(Calibrate, EveryCalibration, testing::ValuesIn(calibrations()),
                         [](const auto& info) { return info.param.name; });

TEST_P(EveryCalibration, TotalMassIsExact) {
  const MassSpringModel model = model_of(GetParam().name);
  EXPECT_NEAR(model.mass.sum(), model.material.rho * lumped_mass(model.network.X, model.network.T, 1).sum(),
              rounding);
}

TEST_P(EveryCalibration, StiffnessScalesWithYoungsModulus) {
  const SpringNetwork network = network_of(box_tets(3, 3, 3, 0.4, 0.1));
  Material stiff = material_of(0.3), soft = stiff;
  stiff.E = 7 * soft.E;
  const Eigen::Matrix3Xd bumped = 1.01 * network.X;
  const auto energy_of = [&](const Material& material) {
    const MassSpringModel model = calibrate(network, material, GetParam());
    State state = initial_state(model);
    state.x = bumped;
    return elastic_energy(model, state);
  };
  EXPECT_NEAR(energy_of(stiff) / energy_of(soft), 7, 1e-4);  // moment is a fit
}

TEST_P(EveryCalibration, NeedsTetrahedraExactlyWhereItSaysSo) {
  SpringNetwork network = network_of(box_tets(3, 3, 3, 0.4, 0.1));
  network.T.resize(4, 0);
  if (GetParam().needs_tetrahedra)
    EXPECT_THROW(calibrate(network, material_of(0.25), GetParam()), std::runtime_error);
  else
    EXPECT_NO_THROW(calibrate(network, material_of(0.25), GetParam()));
}

TEST(Calibrate, SumOfStiffnessTimesSquaredLengthIsThatOfTheContinuum) {
  for (const char* name : {"uniform", "affine", "van_gelder"}) {
    const MassSpringModel model = model_of(name);
    const double V = lumped_mass(model.network.X, model.network.T, 1).sum(), mu = model.material.E / 2.5;
    EXPECT_NEAR(
        model.springs->stiffness.dot(squared_lengths(model.network.X, model.network.E)) / (15 * V * mu), 1,
        rounding)
        << name;
  }
}

TEST(Calibrate, LloydIsVanGelderTimes24By25OnARegularTetrahedron) {
  SpringNetwork network;
  network.X = (Eigen::Matrix3Xd(3, 4) << 1, 1, -1, -1, 1, -1, 1, -1, 1, -1, -1, 1).finished();
  network.F = (Eigen::Matrix3Xi(3, 4) << 0, 0, 0, 1, 1, 2, 3, 3, 2, 3, 1, 2).finished();
  network.T = (Eigen::Matrix4Xi(4, 1) << 0, 1, 2, 3).finished();
  if (rest_volume(network.X, network.T.col(0)) < 0) std::swap(network.T(0, 0), network.T(1, 0));
  network.n_surface = 4;
  const auto k = [&](const char* name) {
    return calibrate(network, material_of(0.25), find_calibration(name)).springs->stiffness.eval();
  };
  EXPECT_LT((k("lloyd") - 24. / 25 * k("van_gelder")).norm(), rounding * k("lloyd").norm());
}

TEST(Calibrate, MomentFitNearlyPassesThePatchTestWhereVanGelderFails) {
  const Diagnostics moment = diagnose(model_of("moment")), van_gelder = diagnose(model_of("van_gelder"));
  EXPECT_GT(van_gelder.uniaxial_error, 0.05);
  EXPECT_LT(moment.uniaxial_error, van_gelder.uniaxial_error / 5);
  EXPECT_GE(model_of("moment").springs->stiffness.minCoeff(), 0);
}

TEST(Calibrate, DilatationTermRaisesTheBulkModulusOfSprings) {
  const auto volume_work = [](double nu) {
    const MassSpringModel model = model_of("van_gelder", nu);
    State state = initial_state(model);
    constexpr double kStrain = 1e-5;
    state.x *= 1 + kStrain;
    const double V = lumped_mass(model.network.X, model.network.T, 1).sum();
    return elastic_energy(model, state) /
           (4.5 * V * kStrain * kStrain * model.material.E / (3 * (1 - 2 * nu)));
  };
  for (double nu : {0.25, 0.4, 0.49})
    EXPECT_NEAR(volume_work(nu), 1, 1e-3) << nu;  // third-order terms of strain 1e-5
}

TEST(Calibrate, LinksBesideCoupledSpringsKeepTheBulkModulus) {
  constexpr double kStrain = 1e-5, share = 0.3;
  const SpringNetwork network = network_of(box_tets(4, 3, 3, 0.4, 0.2));
  for (double nu : {0.25, 0.45}) {
    const Calibration& calibration = find_calibration("node_averaged");
    const MassSpringModel model = calibrate_with_links(network, material_of(nu), calibration, share);
    State state = initial_state(model);
    state.x *= 1 + kStrain;
    const double V = lumped_mass(network.X, network.T, 1).sum();
    const double expected = 4.5 * V * kStrain * kStrain * model.material.E / (3 * (1 - 2 * nu));
    EXPECT_NEAR(elastic_energy(model, state) / expected, 1, 1e-3) << nu;  // third-order terms
    const double by_links = energy(*model.springs, state.rest_length, state.x) / expected;
    const auto [lambda, mu] = lame_of(model.material);
    EXPECT_NEAR(by_links, share * 5 * mu / (3 * lambda + 2 * mu), 1e-3) << nu;
  }
  EXPECT_THROW(calibrate_with_links(network, material_of(0.1), find_calibration("node_averaged"), share),
               std::runtime_error);
  EXPECT_THROW(calibrate_with_links(network, material_of(0.3), find_calibration("van_gelder"), share),
               std::runtime_error);
}

TEST(Calibrate, RefusesByNameWhatItCannotDo) {
  EXPECT_NE(refusal_of("van_gelder", 0.2).find("0.25"), std::string::npos);
  EXPECT_NE(refusal_of("moment", 0.2).find("0.25"), std::string::npos);
  EXPECT_NE(refusal_of("node_averaged", 0.4995).find("0.499"), std::string::npos);
  EXPECT_NE(refusal_of("node_averged", 0.3).find("did you mean node_averaged?"), std::string::npos);
  EXPECT_NE(refusal_of("nothing_like_it", 0.3).find("van_gelder"), std::string::npos);
}

}  // namespace
}  // namespace testbed
