// The balance of energy, on sums that are known.
#include <gtest/gtest.h>

#include <limits>

#include "meshing/surface_energies/energy_ledger.h"

namespace testbed::meshing {
namespace {

using Eigen::Matrix3Xd;

/// An energy of any value, of which friction's potential is a part.
struct Given : SurfaceEnergy {
  double value = 0, potential = 0, taken = 0, done = 0;
  bool is_contact = false;
  const char* name() const override { return "given"; }
  double energy(const Matrix3Xd&) const override { return value; }
  double stored(const Matrix3Xd&) const override { return value - potential; }
  double friction(const Matrix3Xd&) const override { return taken; }
  double work(const Matrix3Xd&) const override { return done; }
  void add_forces(const Matrix3Xd&, Matrix3Xd&) const override {}
  void add_hessian(const Matrix3Xd&, SurfaceHessian&, Curvature) const override {}
  bool is_stiff() const override { return is_contact; }
};

double column(const EnergyLedger& ledger, const SurfaceEnergies& surface, const std::string& name) {
  for (const auto& [column, value] : ledger.columns(surface, 0, 0))
    if (column == name) return value;
  return std::numeric_limits<double>::quiet_NaN();
}

const Matrix3Xd kNowhere(3, 0);

TEST(EnergyLedger, CountsGrowthFromTheLowestBalance) {
  EnergyLedger ledger;
  ledger.begin(10, 0, {}, kNowhere, 0);
  ledger.settle(5, 0);
  EXPECT_EQ(ledger.gain(), 0);
  ledger.settle(5.5, 0);
  EXPECT_DOUBLE_EQ(ledger.gain(), 0.05);
  EXPECT_FALSE(ledger.has_gained());
  ledger.settle(0, 7);
  EXPECT_DOUBLE_EQ(ledger.gain(), 0.2);
  EXPECT_TRUE(ledger.has_gained());
}

TEST(EnergyLedger, CountsNoWorkAsGain) {
  EnergyLedger ledger;
  ledger.begin(1, 0, {}, kNowhere, 0);
  for (double EnergyFlows::*work : {&EnergyFlows::loads, &EnergyFlows::supports, &EnergyFlows::obstacles,
                                    &EnergyFlows::targets, &EnergyFlows::rest})
    ledger.flows.*work += 2;
  ledger.settle(4, 7);
  EXPECT_EQ(ledger.gain(), 0);
  EXPECT_EQ(ledger.columns({}, 4, 7).back().second, 0);
}

TEST(EnergyLedger, TakesRoundingForNoGain) {
  EnergyLedger ledger;
  ledger.begin(0, 0, {}, kNowhere, 1e-9);
  ledger.settle(1e-10, 0);
  EXPECT_EQ(ledger.gain(), 0);
  ledger.settle(1e-8, 0);
  EXPECT_TRUE(ledger.has_gained());
}

TEST(EnergyLedger, TellsTargetsFromObstaclesAndFrictionFromWhatIsStored) {
  const auto given = std::make_shared<Given>();
  const SurfaceEnergies surface{given};
  for (const bool is_contact : {false, true}) {
    *given = {};
    given->is_contact = is_contact;
    EnergyLedger ledger;
    ledger.begin(0, 0, surface, kNowhere, 0);
    given->value = 3;
    ledger.begin_step(surface, kNowhere);
    given->value = 5;
    given->potential = 1;
    given->taken = 0.75;
    given->done = 2;
    ledger.end_step(surface, kNowhere);
    EXPECT_EQ(column(ledger, surface, "given_energy"), 4);
    EXPECT_EQ(column(ledger, surface, "work_of_targets"), is_contact ? 0 : 3 + 2);
    EXPECT_EQ(column(ledger, surface, "work_of_obstacles"), is_contact ? 2 : 0);
    EXPECT_EQ(column(ledger, surface, "lost_to_friction"), 0.75);
    EXPECT_EQ(column(ledger, surface, "lost_to_scheme"), (is_contact ? 2 : 5) - 0.75 - 4);
  }
}

TEST(EnergyLedger, HasOneColumnForEnergiesOfOneName) {
  SurfaceEnergies surface;
  for (const double value : {3., 4.}) {
    surface.push_back(std::make_shared<Given>());
    static_cast<Given&>(*surface.back()).value = value;
  }
  EnergyLedger ledger;
  ledger.begin(0, 0, surface, kNowhere, 0);
  EXPECT_EQ(column(ledger, surface, "given_energy"), 7);
}

TEST(EnergyLedger, CountsWhatAnEventChangesOfAllEnergies) {
  const auto given = std::make_shared<Given>();
  const SurfaceEnergies surface{given};
  given->value = 1;
  EnergyLedger ledger;
  ledger.begin(0, 0, surface, kNowhere, 0);
  given->value = 4;
  ledger.change(2, surface, kNowhere, 0);
  EXPECT_EQ(column(ledger, surface, "work_of_events"), 2 + 3);
  ledger.settle(0, 2);
  EXPECT_EQ(ledger.gain(), 0);
}

TEST(EnergyLedger, BeginsAfterTheFirstStepOfABodyThatTouches) {
  const auto given = std::make_shared<Given>();
  const SurfaceEnergies surface{given};
  given->value = std::numeric_limits<double>::infinity();
  given->is_contact = true;
  EnergyLedger ledger;
  ledger.begin(1, 0, surface, kNowhere, 0);
  EXPECT_EQ(column(ledger, surface, "given_energy"), 0);
  ledger.begin_step(surface, kNowhere);
  given->value = 5;
  ledger.end_step(surface, kNowhere);
  ledger.settle(1, 0);
  EXPECT_EQ(ledger.gain(), 0);
  given->value = 8;
  ledger.end_step(surface, kNowhere);
  ledger.settle(1, 0);
  EXPECT_DOUBLE_EQ(ledger.gain(), 1);
}

}  // namespace
}  // namespace testbed::meshing
