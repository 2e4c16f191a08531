// A run in contact with friction goes on from its state as if nothing had stopped it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "tests/fem_reference/solid/bars.h"

namespace testbed::fem {
namespace {

using Eigen::Vector3d;

constexpr double kSolved = 1e-8;  // m: what is kept changes a step within its tolerance

class StateInContact : public testing::TestWithParam<std::pair<const char*, int>> {};
INSTANTIATE_TEST_SUITE_P(, StateInContact,
                         testing::Values(std::pair("generalised_alpha", 1), std::pair("generalised_alpha", 2),
                                         std::pair("minimising_euler", 1), std::pair("minimising_euler", 2)));

TEST_P(StateInContact, IsAllThatDecidesHowAMotionGoesOn) {
  const auto& [integrator, degree] = GetParam();
  Bars bars(integrator, degree);
  Simulation whole = bars.simulation(), again = bars.simulation(), restored = bars.simulation(),
             forgetful = bars.simulation();
  const State middle = after(kBefore, whole).state();
  const std::string saved = whole.saved();
  const int n_newton = whole.integrator()->counts().newton_iterations;
  EXPECT_GT(n_newton, 0);
  for (const char* column :
       {"barrier_energy", "self_contact_energy", "volume_energy", "membrane_energy", "lost_to_friction"})
    EXPECT_GT(column_of(whole, column), 0) << column;
  after(kAfter, whole);
  again.set_state(middle);
  restored.restore(saved);
  EXPECT_EQ(restored.integrator()->counts().newton_iterations, n_newton);
  after(kBefore, forgetful).set_state(middle);
  for (Simulation* other : {&again, &restored, &forgetful}) {
    after(kAfter, *other);
    EXPECT_LT(apart(*other, whole), kSolved);
    EXPECT_EQ(other->snapshot().time, whole.snapshot().time);
    EXPECT_EQ(other->n_steps(), whole.n_steps());
    for (const char* column : {"lost_to_friction", "work_of_rest", "work_of_supports"}) {
      const double expected = column_of(whole, column);
      EXPECT_NEAR(column_of(*other, column), expected, 1e-6 * std::abs(expected)) << column;
    }
  }
  EXPECT_EQ(apart(again, forgetful), 0) << "forgotten";
  EXPECT_THROW(again.restore(saved.substr(0, saved.size() - 1)), std::runtime_error);
}

// Rest lengths of the skin, which have relaxed.
TEST_P(StateInContact, WithoutWhatTheSurfaceRemembersGoesElsewhere) {
  const auto& [integrator, degree] = GetParam();
  Bars bars(integrator, degree);
  Simulation whole = bars.simulation(), again = bars.simulation();
  State middle = after(kBefore, whole).state();
  ASSERT_EQ(middle.motion.surface.size(), 1u);
  middle.motion.surface = {};
  again.set_state(middle);
  EXPECT_GT(apart(after(kAfter, again), after(kAfter, whole)), 100 * kSolved);
}

TEST(SelfContact, HasTheScenesFriction) {
  Bars rough("minimising_euler"), smooth("minimising_euler");
  smooth.scene.self_contact.friction = 0;
  Simulation first = rough.simulation(), second = smooth.simulation();
  EXPECT_GT(apart(after(kBefore + kAfter, first), after(kBefore + kAfter, second)), 100 * kSolved);
}

// Bars are pressed down onto the floor and pushed along it.
TEST(State, OfStaticsInContactIsAllThatDecidesHowTheyGoOn) {
  for (const int degree : {1, 2}) {
    Bars bars("generalised_alpha", degree);
    bars.scene.self_contact = {};
    bars.scene.time.mode = TimeMode::Static;
    bars.scene.time.load_steps = 6;
    bars.scene.supports[0].motion.clear();
    bars.scene.supports[0].displacement = Vector3d(0.02, -0.05, 0);
    bars.scene.collapse->coefficient = 0.05;
    bars.scene.supports[0].region.shape = HalfSpace{Vector3d(0, 0.2, 0), Vector3d(0, -1, 0)};
    Simulation whole = bars.simulation(), again = bars.simulation();
    const State middle = after(3, whole).state();
    after(3, whole);
    again.set_state(middle);
    EXPECT_LT(apart(after(3, again), whole), kSolved) << degree;
    EXPECT_TRUE(again.has_ended());
    double touched = 0;
    for (const auto& [column, value] : whole.snapshot().contact) touched = std::max(touched, std::abs(value));
    EXPECT_GT(touched, 1) << "N";
  }
}

}  // namespace
}  // namespace testbed::fem
