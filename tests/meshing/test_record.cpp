#include <gtest/gtest.h>
#include <vtkDoubleArray.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridReader.h>

#include "meshing/files.h"
#include "meshing/record.h"

namespace testbed {
namespace {

namespace fs = std::filesystem;

class RecorderTest : public testing::Test {
 protected:
  fs::path folder = fs::temp_directory_path() / "testbed_record";
  Eigen::Matrix3Xd X = Eigen::Matrix3Xd::Random(3, 4), u = 1e-3 * Eigen::Matrix3Xd::Random(3, 4);
  std::vector<CellBlock> cells{{5, Eigen::Vector3i(0, 1, 2)}, {10, Eigen::Vector4i(0, 1, 2, 3)}};
  void SetUp() override { fs::remove_all(folder); }
};

TEST_F(RecorderTest, FramesHoldEveryBitOfPositionsAndFields) {
  Recorder recorder(folder, cells, 3);
  recorder.add_frame(0.25, X, u);
  vtkNew<vtkXMLUnstructuredGridReader> reader;
  reader->SetFileName((folder / "frames/frame_000000.vtu").c_str());
  reader->Update();
  vtkUnstructuredGrid* grid = reader->GetOutput();
  ASSERT_EQ(grid->GetNumberOfPoints(), 4);
  ASSERT_EQ(grid->GetNumberOfCells(), 2);
  EXPECT_EQ(grid->GetCellType(1), 10);
  for (int i = 0; i < 4; ++i)
    for (int c = 0; c < 3; ++c) {
      EXPECT_EQ(grid->GetPoint(i)[c], X(c, i) + u(c, i));
      EXPECT_EQ(grid->GetPointData()->GetArray("displacement")->GetComponent(i, c), u(c, i));
    }
  EXPECT_EQ(grid->GetFieldData()->GetArray("TimeValue")->GetComponent(0, 0), 0.25);
  EXPECT_EQ(grid->GetFieldData()->GetArray("n_surface")->GetComponent(0, 0), 3);
}

TEST_F(RecorderTest, NothingThatIsNotFiniteIsWritten) {
  Recorder recorder(folder, cells, 3);
  u(1, 2) = NAN;
  EXPECT_THROW(recorder.add_frame(0, X, u), std::runtime_error);
  EXPECT_FALSE(fs::exists(folder / "frames.pvd"));
  EXPECT_THROW(recorder.add_row({{"time", 0}, {"volume", INFINITY}}), std::runtime_error);
}

TEST_F(RecorderTest, ARunIsUpToDateOnlyWhenFinishedWithTheSameHash) {
  {
    Recorder recorder(folder, cells, 3);
    recorder.add_frame(0, X, u);
    recorder.add_row({{"time", 0.1}, {"volume", 1.0 / 3}});
    recorder.add_row({{"time", 0.2}, {"volume", 2.0 / 3}});
    EXPECT_FALSE(is_up_to_date(folder, "abc")) << "a folder without run.json is no result";
    recorder.finish({{"status", "ok"}, {"input_hash", "abc"}});
  }
  EXPECT_TRUE(is_up_to_date(folder, "abc"));
  EXPECT_FALSE(is_up_to_date(folder, "abd"));
  EXPECT_EQ(read_file(folder / "curves.csv"),
            "time,volume\n0.1,0.3333333333333333\n0.2,0.6666666666666666\n");
  const Recorder next(folder, cells, 3);
  EXPECT_FALSE(fs::exists(folder / "run.json")) << "an older run is removed";
}

TEST(Hash, DependsOnEveryByte) {
  EXPECT_EQ(hash_of(""), "cbf29ce484222325");   // the published offset basis
  EXPECT_EQ(hash_of("a"), "af63dc4c8601ec8c");  // published test vector of FNV-1a
  EXPECT_NE(hash_of("ab"), hash_of("ba"));
}

TEST(StageTimer, AddsUpStagesThatRunTwice) {
  StageTimer timer;
  timer.start("solve");
  timer.start("output");
  timer.start("solve");
  timer.stop();
  const auto seconds = timer.seconds();
  EXPECT_EQ(seconds.size(), 2u);
  EXPECT_GE(seconds.at("solve").get<double>(), 0);
}

}  // namespace
}  // namespace testbed
