#include <gtest/gtest.h>

#include "fem_reference/solid/schemes.h"

namespace testbed::fem {
namespace {

std::string refusal_of(const Scene& scene) {
  try {
    check_scheme(scene, "a.toml");
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(CheckScheme, RefusesASpectralRadiusOfCentralDifferences) {
  Scene scene;
  scene.reference.spectral_radius = 0.5;
  EXPECT_EQ(refusal_of(scene), "");
  scene.reference.integrator = "central_differences";
  EXPECT_EQ(refusal_of(scene),
            "a.toml: reference.spectral_radius = 0.5, expected none with reference.integrator = "
            "central_differences, which has no such parameter");
}

TEST(CheckScheme, RefusesANameThatIsNotKnownWithItsPlaceAndTheKnownOnes) {
  Scene scene;
  scene.reference.integrator = "central_difference";
  scene.places["reference.integrator"] = "a.toml:7";
  EXPECT_EQ(refusal_of(scene),
            "a.toml:7: reference.integrator = 'central_difference': no such scheme, did you mean "
            "central_differences? (known: generalised_alpha, minimising_euler, central_differences)");
}

}  // namespace
}  // namespace testbed::fem
