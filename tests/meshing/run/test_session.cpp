// What a session keeps of a run that goes on.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "meshing/base/files.h"
#include "meshing/run/session.h"

namespace testbed::meshing {
namespace {

namespace fs = std::filesystem;

class SessionOfABall : public testing::Test {
 protected:
  const fs::path folder = fs::temp_directory_path() / ("session_" + std::to_string(getpid()));
  Scene scene;
  SessionOptions options;

  void SetUp() override {
    fs::remove_all(folder);
    scene.surface.shape = "ball";
    scene.surface.n_vertices = 42;
    scene.time.mode = TimeMode::Dynamic;
    scene.initial.emplace_back().velocity = {1, 0, 0};
    options.scene = "scene.toml";
    options.out = folder;
    options.is_quiet = options.is_checked = true;
  }
  void TearDown() override { fs::remove_all(folder); }
};

TEST_F(SessionOfABall, GoesOnWithTheLeastJacobianOfBefore) {
  const auto begin = [](Session& session) {
    EXPECT_FALSE(session.stored_status({}, ""));
    session.open(session.surface.X, session.surface, {}, 1);
  };
  const auto snapshot_of = [](const Session& session, double time, double least) {
    return Snapshot{time, 1, Eigen::Matrix3Xd::Zero(3, session.surface.X.cols()),
                    0,    0, {{"min_J_nodes", least}}};
  };
  {
    Session killed("massspring", options, scene);
    begin(killed);
    killed.add(snapshot_of(killed, 0, 0.25), 0, false);
    killed.save("state");
  }
  Session session("massspring", options, scene);
  begin(session);
  ASSERT_TRUE(session.saved_simulation());
  EXPECT_EQ(*session.saved_simulation(), "state");
  session.add(snapshot_of(session, 1, 0.5), 1, true);
  session.record["status"] = "ok";
  EXPECT_EQ(session.finish(), kSolved);
  EXPECT_EQ(nlohmann::json::parse(read_file(folder / "run.json"))["min_J_nodes"], 0.25);
}

TEST_F(SessionOfABall, BlamesAFlatTetrahedronWhereNothingConverges) {
  const auto reason_of = [&](double ratio, const char* status) {
    Session session("massspring", options, scene);
    session.record["tetrahedra"]["min_radius_ratio"] = ratio;
    session.record["status"] = status;
    session.record["reason"] = "it stands still";
    session.finish();
    return session.record["reason"].get<std::string>();
  };
  EXPECT_EQ(reason_of(1e-9, "not_converged"),
            "it stands still; the flattest tetrahedron has a radius ratio of 1e-09, expected 1e-06 or more: "
            "./testbed run --remesh makes an even surface");
  EXPECT_EQ(reason_of(1e-5, "not_converged"), "it stands still");
  EXPECT_EQ(reason_of(1e-9, "diverged"), "it stands still");
}

}  // namespace
}  // namespace testbed::meshing
