#include <gtest/gtest.h>

#include "meshing/files.h"
#include "meshing/scene.h"
#include "meshing/shapes.h"
#include "meshing/surface.h"

namespace testbed {
namespace {

namespace fs = std::filesystem;

fs::path write_scene(const std::string& text) {
  const fs::path file = fs::temp_directory_path() / "testbed_scene.toml";
  write_file(file, text);
  return file;
}

std::string error_of(const std::string& text, const std::vector<std::string>& overrides = {}) {
  const fs::path file = write_scene(text);
  try {
    read_scene(file, overrides);
  } catch (const std::runtime_error& error) {
    std::string message = error.what();
    if (message.rfind(file.string(), 0) == 0) message.replace(0, file.string().size(), "scene.toml");
    return message;
  }
  return "";
}

const std::string kFull = R"(name = "all"
gravity = [0, 0, -9.81]
[surface]
shape = "torus"
n_vertices = 924
[material]
E = 2e6
nu = 0.3
[[supports]]
region = { box = { low = [0, 0, 0], high = [1, 1, 0.1] }, relative = true }
components = "xz"
displacement = [0, 0, 0.1]
[[supports]]
region = { sphere = { center = [0, 1, 2], radius = 0.5 } }
[[loads]]
pressure = 0.1
[[loads]]
traction = [1, 2, 3]
region = { plane = { point = [0, 0, 1], normal = [0, 0, -1] } }
[collapse]
coefficient = 0.25
[[collapse.pivots]]
point = [1, 2, 3]
[[obstacles]]
plane = { point = [0, 0, 0], normal = [0, 0, 1] }
[time]
mode = "dynamic"
integrator = "symplectic_euler"
step = 1e-3
[network]
k = 500
seed = 18446744073709
[comparison]
calibrations = ["uniform", "lloyd"]
)";

TEST(Scene, IsReadWithItsValues) {
  const Scene scene = read_scene(write_scene(kFull));
  EXPECT_EQ(scene.name, "all");
  EXPECT_EQ(scene.gravity->z(), -9.81);
  EXPECT_EQ(scene.material.E, 2e6);
  ASSERT_EQ(scene.supports.size(), 2u);
  EXPECT_EQ(scene.supports[0].fixed, (std::array<bool, 3>{true, false, true}));
  EXPECT_EQ(std::get<Box>(scene.supports[0].region.shape).high.z(), 0.1);
  EXPECT_TRUE(scene.supports[0].region.relative);
  EXPECT_EQ(std::get<Ball>(scene.supports[1].region.shape).radius, 0.5);
  EXPECT_EQ(scene.loads[1].traction.y(), 2);
  EXPECT_EQ(scene.collapse->pivots[0].point.z(), 3);
  EXPECT_EQ(scene.time.integrator, Integrator::SymplecticEuler);
  EXPECT_EQ(*scene.network.k, 500);
  EXPECT_FALSE(scene.network.phi);
  EXPECT_EQ(scene.comparison.calibrations, (std::vector<std::string>{"uniform", "lloyd"}));
}

TEST(Scene, FilledInFileGivesTheSameSceneAgain) {
  const std::string filled = to_toml(read_scene(write_scene(kFull)));
  EXPECT_EQ(to_toml(read_scene(write_scene(filled))), filled);
  EXPECT_NE(filled.find("pressure = 0.1 "), std::string::npos) << "numbers are written shortest";
}

TEST(Scene, OverridesReplaceAddAndReachIntoLists) {
  const Scene scene =
      read_scene(write_scene(kFull), {"material.nu=0.45", "loads.0.pressure=-7", "reference.degree=1",
                                      "network.calibration=lloyd", "gravity=[1,2,3]"});
  EXPECT_EQ(scene.material.nu, 0.45);
  EXPECT_EQ(scene.loads[0].pressure, -7);
  EXPECT_EQ(scene.reference.degree, 1);
  EXPECT_EQ(scene.network.calibration, "lloyd");
  EXPECT_EQ(scene.gravity->x(), 1);
}

TEST(Scene, ErrorsNameFileLineKeyValueAndWhatIsAllowed) {
  const std::string ball = "[surface]\nshape = \"ball\"\n";
  EXPECT_EQ(error_of(ball + "[time]\nstep = -0.01\n"), "scene.toml:4: time.step = -0.01, expected >= 0");
  EXPECT_EQ(error_of(ball + "[material]\nnu = 0.5\n"),
            "scene.toml:4: material.nu = 0.5, expected in (-1, 0.5)");
  EXPECT_EQ(error_of(ball + "[material]\nE = \"soft\"\n"),
            "scene.toml:4: material.E = 'soft', expected a number");
  EXPECT_EQ(error_of(ball + "[material]\nyoung = 1\n"),
            "scene.toml:4: material.young: unknown key (known: E, nu, rho, damping)");
  EXPECT_EQ(error_of(ball + "[material]\nrh = 1\n"),
            "scene.toml:4: material.rh: unknown key, did you mean rho? (known: E, nu, rho, damping)");
  EXPECT_EQ(error_of(ball + "[time]\nmode = \"slow\"\n"),
            "scene.toml:4: time.mode = 'slow', expected one of static, dynamic");
  EXPECT_EQ(error_of("[surface]\nshape = \"ball\"\nfile = \"a.obj\"\n"),
            "scene.toml: surface.file and surface.shape are both given, expected one of them");
  EXPECT_EQ(error_of(ball + "[network]\nmultiplicity = 2\n"),
            "scene.toml:4: network.multiplicity = 2, expected >= 3");
  EXPECT_EQ(error_of(ball + "gravity = [0, 1]\n"),
            "scene.toml:3: surface.gravity: unknown key (known: file, shape, "
            "n_vertices, size, scale, normalise)");
  EXPECT_EQ(error_of(ball, {"material.nu=0.9"}),
            "--set material.nu=0.9: material.nu = 0.9, expected in (-1, 0.5)");
  EXPECT_EQ(error_of(ball, {"loads.0.pressure=1"}), "--set: loads is a table, expected [[loads]]");
  EXPECT_NE(error_of(ball + "[time\n").find("scene.toml:3: "), std::string::npos);
  EXPECT_EQ(error_of(ball + "[[supports]]\nregion = { box = { low = [0,0,0], high = [1,1,1] }, plane = { "
                            "point = [0,0,0], normal = [0,0,1] } }\n"),
            "scene.toml:4: supports.0.region. has both box and plane, expected one of them");
}

TEST(Scene, FilesAreRelativeToTheSceneAndOverridesToTheCurrentFolder) {
  const std::string text = "[surface]\nfile = \"mesh.obj\"\n";
  EXPECT_EQ(read_scene(write_scene(text)).surface.file, fs::temp_directory_path() / "mesh.obj");
  EXPECT_EQ(read_scene(write_scene(text), {"surface.file=other.obj"}).surface.file,
            fs::current_path() / "other.obj");
}

TEST(LoadSurface, NormalisesTheSmallestSideToOne) {
  const SurfaceMesh mesh = load_surface({"", "bar", 100, {3, 2, 0.5}, 7, true});
  const Eigen::Vector3d low = mesh.X.rowwise().minCoeff(), high = mesh.X.rowwise().maxCoeff();
  EXPECT_LT((high - low - Eigen::Vector3d(6, 4, 1)).norm(), 1e-12);
  EXPECT_LT((high + low).norm(), 1e-12);
}

TEST(Region, SelectsByPosition) {
  const SurfaceMesh cube = make_shape("bar", 26, {2, 2, 2});  // 3 x 3 x 3 grid points less the centre
  EXPECT_EQ(vertices_in({Everywhere{}, false}, cube).size(), 26u);
  EXPECT_EQ(vertices_in({HalfSpace{{0, 0, 0}, {0, 0, 1}}, false}, cube).size(), 9u);
  EXPECT_EQ(vertices_in({HalfSpace{{0, 0, 0.5}, {0, 0, 1}}, true}, cube).size(), 17u);
  EXPECT_EQ(triangles_in({HalfSpace{{0, 0, 0}, {0, 0, 1}}, false}, cube).size(), 8u);
  EXPECT_EQ(vertices_in({Box{{0, 0, 0}, {0.5, 0.5, 0.5}}, true}, cube).size(), 7u);
  EXPECT_EQ(vertices_in({Ball{{0, 0, 0}, 1}, false}, cube).size(), 4u);
}

}  // namespace
}  // namespace testbed
