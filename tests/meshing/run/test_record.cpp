#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vtkDoubleArray.h>
#include <vtkFieldData.h>
#include <vtkIdTypeArray.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLPUnstructuredGridReader.h>
#include <vtkXMLUnstructuredGridReader.h>

#include <cmath>
#include <csignal>
#include <fstream>
#include <functional>
#include <thread>
#include <vector>

#include "meshing/base/child_process.h"
#include "meshing/base/files.h"
#include "meshing/base/folder_lock.h"
#include "meshing/run/hash.h"
#include "meshing/run/record.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_io.h"

namespace testbed::meshing {
namespace {

namespace fs = std::filesystem;

class RecorderTest : public testing::Test {
 protected:
  // Its own for every test: ctest runs them side by side.
  fs::path folder = fs::temp_directory_path() /
                    (std::string("testbed_") + testing::UnitTest::GetInstance()->current_test_info()->name());
  Eigen::Matrix3Xd X = Eigen::Matrix3Xd::Random(3, 4), u = 1e-3 * Eigen::Matrix3Xd::Random(3, 4);
  std::vector<CellBlock> cells{{5, Eigen::Vector3i(0, 1, 2)}, {10, Eigen::Vector4i(0, 1, 2, 3)}};
  void SetUp() override { fs::remove_all(folder); }
  void TearDown() override { fs::remove_all(folder); }
};

TEST(PeakMemory, IsTheMostThatAProcessHasHeld) {
  constexpr std::size_t kBytes = 200'000'000;  // what the rest of the test holds is far less
  {
    std::vector<char> large(kBytes, 1);
    EXPECT_EQ(large.back(), 1);
  }
  EXPECT_GE(peak_memory(), kBytes);
  EXPECT_LT(peak_memory(), 4 * kBytes);
}

TEST_F(RecorderTest, FramesHoldEveryBitOfPositionsAndFields) {
  Recorder recorder(folder, cells, 3);
  recorder.add_frame(0.25, X, u);
  ASSERT_EQ(recorder.recorded().frames.size(), 1) << "and is written";
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
      EXPECT_EQ(grid->GetPointData()->GetArray("rest_position")->GetComponent(i, c), X(c, i));
    }
  const auto* node_id = vtkIdTypeArray::SafeDownCast(grid->GetPointData()->GetArray("node_id"));
  ASSERT_NE(node_id, nullptr) << "node ids are integers";
  for (int i = 0; i < 4; ++i) EXPECT_EQ(node_id->GetValue(i), i);
  EXPECT_EQ(grid->GetFieldData()->GetArray("TimeValue")->GetComponent(0, 0), 0.25);
  EXPECT_EQ(grid->GetFieldData()->GetArray("n_surface")->GetComponent(0, 0), 3);
}

TEST_F(RecorderTest, TheListOfFramesHoldsEveryBitOfTheirTimes) {
  const std::vector<double> times{0, 1.0 / 3, 1234567.0 / 1024};
  Recorder recorder(folder, cells, 3);
  for (double time : times) recorder.add_frame(time, X, u);
  EXPECT_EQ(recorder.recorded().frames.size(), times.size());
  const std::string pvd = read_file(folder / "frames.pvd"), before = "timestep=\"";
  size_t at = 0;
  for (double time : times) {
    at = pvd.find(before, at);
    ASSERT_NE(at, std::string::npos) << pvd;
    at += before.size();
    EXPECT_EQ(std::stod(pvd.substr(at)), time);
  }
}

TEST_F(RecorderTest, PeakMemoryIsInBytes) {
  constexpr size_t kBytes = 100'000'000;  // by far the most that this process has held
  const std::vector<char> block(kBytes, 1);
  Recorder(folder, cells, 3).finish({});
  const auto peak = nlohmann::json::parse(read_file(folder / "run.json")).at("peak_memory").get<double>();
  std::ifstream statm("/proc/self/statm");  // in pages, and of this moment
  double all_pages = 0, resident_pages = 0;
  if (!(statm >> all_pages >> resident_pages)) GTEST_SKIP() << "no /proc/self/statm";
  const double resident = resident_pages * static_cast<double>(sysconf(_SC_PAGESIZE));
  ASSERT_GE(resident, kBytes * block[kBytes / 2]);
  EXPECT_NEAR(peak / resident, 1, 0.01) << "a kB of 1000 byte would be 2.3 % off";
}

TEST_F(RecorderTest, NothingThatIsNotFiniteIsWritten) {
  Recorder recorder(folder, cells, 3);
  const auto expect_refusal = [&](double time, const std::vector<Field>& fields) {
    recorder.add_frame(time, X, u, fields);
    EXPECT_THROW(recorder.recorded(), std::runtime_error);
    EXPECT_TRUE(recorder.recorded().frames.empty());
  };
  u(1, 2) = NAN;
  expect_refusal(0, {});
  u(1, 2) = 0;
  expect_refusal(NAN, {});
  expect_refusal(0, {{"velocity", INFINITY * u}});
  EXPECT_TRUE(fs::is_empty(folder / "frames"));
  EXPECT_FALSE(fs::exists(folder / "frames.pvd"));
  EXPECT_THROW(recorder.add_row({{"time", 0}, {"volume", INFINITY}}), std::runtime_error);
  recorder.finish({{"status", "diverged"}});
  EXPECT_FALSE(fs::exists(folder / "curves.csv")) << "no row was accepted";
}

TEST_F(RecorderTest, WhatIsThereOnTheWayIsWholeAndGrowsToWhatIsThereAtTheEnd) {
  Recorder recorder(folder, cells, 3);
  for (int i = 0; i < 3; ++i) {
    recorder.add_frame(i, X, u);
    recorder.add_row({{"time", i}, {"volume", 1}});
  }
  EXPECT_EQ(recorder.recorded().frames.size(), 3);
  const std::string list = read_file(folder / "frames.pvd"), table = read_file(folder / "curves.csv");
  EXPECT_EQ(table, "time,volume\n0,1\n1,1\n2,1\n");
  recorder.finish({});
  EXPECT_EQ(read_file(folder / "frames.pvd"), list);
  EXPECT_EQ(read_file(folder / "curves.csv"), table);
}

TEST_F(RecorderTest, ColumnsThatComeAndGoAreZeroBetween) {
  Recorder recorder(folder, cells, 3);
  recorder.add_row({{"time", 1}, {"volume", 2}});
  recorder.add_row({{"time", 3}, {"force", 5}, {"volume", 4}, {"area", 0.5}});
  recorder.add_row({{"time", 6}, {"area", 7}});
  const std::string expected = "time,volume,force,area\n1,2,0,0\n3,4,5,0.5\n6,0,0,7\n";
  EXPECT_EQ(read_file(folder / "curves.csv"), expected);
  recorder.finish({});
  EXPECT_EQ(read_file(folder / "curves.csv"), expected);
}

TEST_F(RecorderTest, RemovesAnOlderRunAndNothingElse) {
  const auto record_frames = [&](int n) {
    Recorder recorder(folder, cells, 3);
    for (int i = 0; i < n; ++i) recorder.add_frame(i, X, u);
    recorder.finish({});
  };
  record_frames(3);
  write_file(folder / "frames/frame_notes.txt", "mine");
  write_file(folder / "notes.txt", "mine");
  record_frames(1);
  EXPECT_TRUE(fs::exists(folder / "frames/frame_000000.vtu"));
  EXPECT_FALSE(fs::exists(folder / "frames/frame_000001.vtu"));
  EXPECT_EQ(read_file(folder / "frames/frame_notes.txt"), "mine");
  EXPECT_EQ(read_file(folder / "notes.txt"), "mine");
}

TEST_F(RecorderTest, ProcessesWriteAPieceOfAFrameEachAndTheFirstTheirList) {
  {
    Recorder first(folder, cells, 3, nullptr, {2, 0, {0, 1, 2, 9}});
    Recorder second(folder, {{10, Eigen::Vector4i(3, 1, 0, 2)}}, 3, nullptr, {2, 1, {1, 2, 9, 11}});
    for (Recorder* recorder : {&first, &second}) {
      recorder->add_frame(0.5, X, u);
      recorder->recorded();  // waits: VTK is of one thread, and here one process plays both
    }
    first.finish({{"outputs", second.recorded().outputs}});
  }
  const auto outputs = nlohmann::json::parse(read_file(folder / "run.json"))["outputs"];
  for (const char* name :
       {"frames.pvd", "frames/frame_000000.pvtu", "frames/frame_000000_0.vtu", "frames/frame_000000_1.vtu"})
    EXPECT_EQ(outputs[name]["crc32"], crc32_of({read_file(folder / name)})) << name;
  EXPECT_EQ(outputs.size(), 4);
  EXPECT_NE(read_file(folder / "frames.pvd").find("\"frames/frame_000000.pvtu\""), std::string::npos);
  vtkNew<vtkXMLPUnstructuredGridReader> reader;
  reader->SetFileName((folder / "frames/frame_000000.pvtu").c_str());
  reader->Update();
  vtkUnstructuredGrid* grid = reader->GetOutput();
  EXPECT_EQ(grid->GetNumberOfCells(), 3);
  ASSERT_EQ(grid->GetNumberOfPoints(), 8);
  const int number[] = {0, 1, 2, 9, 1, 2, 9, 11};
  for (int i = 0; i < 8; ++i) {
    EXPECT_EQ(grid->GetPointData()->GetArray("node_id")->GetTuple1(i), number[i]);
    EXPECT_EQ(grid->GetPointData()->GetArray("displacement")->GetComponent(i, 1), u(1, i % 4));
  }
  remove_run(folder);
  EXPECT_TRUE(fs::is_empty(folder / "frames"));
}

TEST_F(RecorderTest, AFrameThatCannotBeWrittenThrowsAndPrintsNothing) {
  Recorder recorder(folder, cells, 3);
  fs::remove(folder / "frames");
  testing::internal::CaptureStderr();
  recorder.add_frame(0, X, u);
  EXPECT_THROW(recorder.finish({}), std::runtime_error);
  EXPECT_FALSE(fs::exists(folder / "run.json"));
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST_F(RecorderTest, ARunIsStoredOnlyWhenFinishedWithTheSameHash) {
  {
    Recorder recorder(folder, cells, 3);
    recorder.add_frame(0, X, u);
    recorder.add_row({{"time", 0.1}, {"volume", 1.0 / 3}});
    recorder.add_row({{"time", 0.2}, {"volume", 2.0 / 3}});
    EXPECT_FALSE(stored_record(folder, "abc")) << "a folder without run.json is no result";
    recorder.finish({{"status", "ok"}, {"input_hash", "abc"}});
  }
  ASSERT_TRUE(stored_record(folder, "abc"));
  EXPECT_EQ(stored_record(folder, "abc")->at("status"), "ok");
  EXPECT_FALSE(stored_record(folder, "abd"));
  write_file(folder / "run.json", R"({"status": "diverged", "input_hash": "abc"})");
  EXPECT_FALSE(stored_record(folder, "abc")) << "no file is listed";
  write_file(folder / "run.json", R"({"status": "diverged", "input_hash": "abc", "outputs": {}})");
  ASSERT_TRUE(stored_record(folder, "abc")) << "a run that failed would fail again";
  EXPECT_EQ(stored_record(folder, "abc")->at("status"), "diverged");
  EXPECT_EQ(read_file(folder / "curves.csv"),
            "time,volume\n0.1,0.3333333333333333\n0.2,0.6666666666666666\n");
  const Recorder next(folder, cells, 3);
  EXPECT_FALSE(fs::exists(folder / "run.json")) << "an older run is removed";
}

TEST_F(RecorderTest, ARunOfWhichAFileIsMissingCutOrForeignIsNoStoredOne) {
  const auto record = [&](const fs::path& where, double factor) {
    Recorder recorder(where, cells, 3);
    recorder.add_frame(0, X, factor * u);
    recorder.add_frame(1, X, 2 * factor * u);
    recorder.add_row({{"time", 0}, {"volume", 1}});
    recorder.add_row({{"time", 1}, {"volume", 1 + factor}});
    recorder.finish({{"status", "ok"}, {"input_hash", "abc"}});
  };
  const TemporaryFolder other;
  record(other.path(), 3);
  const auto is_stored_after = [&](const std::function<void()>& damage) {
    record(folder, 1);
    EXPECT_TRUE(stored_record(folder, "abc"));
    damage();
    return stored_record(folder, "abc").has_value();
  };
  for (const char* name :
       {"frames.pvd", "curves.csv", "frames/frame_000000.vtu", "frames/frame_000001.vtu"}) {
    const fs::path file = folder / name;
    EXPECT_FALSE(is_stored_after([&] { fs::remove(file); })) << name;
    EXPECT_FALSE(is_stored_after([&] { write_file(file, ""); })) << name;
    EXPECT_FALSE(is_stored_after([&] {
      std::string bytes = read_file(file);
      bytes[bytes.size() / 2] ^= 1;
      write_file(file, bytes);
    })) << name;
    EXPECT_FALSE(is_stored_after([&] {
      fs::remove(file);
      fs::create_directory(file);
    })) << name;
    fs::remove_all(file);
  }
  EXPECT_FALSE(is_stored_after([&] {
    fs::copy_file(other.path() / "frames/frame_000001.vtu", folder / "frames/frame_000001.vtu",
                  fs::copy_options::overwrite_existing);
  })) << "whole, but of another run";
  EXPECT_FALSE(is_stored_after([&] { write_file(folder / "curves.csv", "time,volume\n0,1\n"); }))
      << "cut at the end of a line";
}

TEST_F(RecorderTest, ADamagedRecordIsNoStoredOne) {
  fs::create_directories(folder);
  for (const char* damaged : {"", "{\"status\": \"ok\"", "[]", R"({"status": 3, "input_hash": null})",
                              R"({"status": "ok", "input_hash": "abc", "outputs": []})",
                              R"({"status": "ok", "input_hash": "abc", "outputs": {"run.json": 3}})"}) {
    write_file(folder / "run.json", damaged);
    EXPECT_FALSE(stored_record(folder, "abc")) << damaged;
  }
}

TEST(Environment, NamesProgramVersionsBuildAndMachine) {
  const auto record = environment_record("massspring", 3);
  EXPECT_EQ(record.at("program"), "massspring");
  EXPECT_EQ(record.at("program_hash"), program_hash());
  for (const char* key : {"date", "compiler", "build", "eigen", "vtk", "processor"})
    EXPECT_GT(record.at(key).get<std::string>().size(), 1u) << key;
  EXPECT_GE(record.at("cores"), 1);
  EXPECT_EQ(record.at("threads"), 3);
}

TEST_F(RecorderTest, ItsFramesAreReadAsTheSurfaceTheyShow) {
  const SurfaceMesh ball = make_shape("ball", 42);
  Eigen::Matrix3Xd X(3, 43);  // an internal node, which no triangle uses
  X << ball.X, Eigen::Vector3d::Zero();
  const Eigen::Vector4i tet(ball.F(0, 0), ball.F(1, 0), ball.F(2, 0), 42);
  Recorder recorder(folder, {{5, ball.F}, {10, tet}}, 42);
  recorder.add_frame(0, X, Eigen::Matrix3Xd::Zero(3, 43));
  ASSERT_EQ(recorder.recorded().frames.size(), 1) << "and is written";
  const SurfaceMesh again = read_surface(folder / "frames/frame_000000.vtu");
  EXPECT_NO_THROW(check_closed(again, "frame"));
  EXPECT_EQ(again.X.cols(), 42);
  EXPECT_EQ(volume(again.X, again.F), volume(ball.X, ball.F));
  write_file(folder / "broken.vtu", "<VTKFile");
  EXPECT_THROW(read_surface(folder / "broken.vtu"), std::runtime_error);
}

TEST(WriteFile, SaysWhyAFileCannotBeWritten) {
  const TemporaryFolder folder;
  const auto message = [](const std::filesystem::path& file) -> std::string {
    try {
      write_file(file, "text");
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "";
  };
  const std::string full = (folder.path() / "full").string(), lost = (folder.path() / "none/lost").string();
  std::filesystem::create_symlink("/dev/full", full + ".tmp");
  EXPECT_EQ(message(full), full + ".tmp: cannot be written: No space left on device");
  EXPECT_EQ(message(lost), lost + ".tmp: cannot be written: No such file or directory");
  EXPECT_FALSE(std::filesystem::exists(full));
}

TEST(FolderLock, IsHeldByOneProcessAtATimeWhichIsNamed) {
  const TemporaryFolder folder;
  std::vector<std::string> told;
  const auto tell = [&](const std::string& text) { told.push_back(text); };
  { const FolderLock alone(folder.path() / "new", tell); }
  EXPECT_TRUE(told.empty());
  int ready[2];
  ASSERT_EQ(pipe(ready), 0);
  const pid_t child = fork();
  if (child == 0) {
    const FolderLock lock(folder.path() / "new", [](const std::string&) {});
    (void)!write(ready[1], "x", 1);
    pause();
  }
  char letter = 0;
  ASSERT_EQ(read(ready[0], &letter, 1), 1);
  // Told first, then given the folder as the other dies, whatever it was doing.
  const FolderLock second(folder.path() / "new", [&](const std::string& text) {
    tell(text);
    kill(child, SIGKILL);
  });
  waitpid(child, nullptr, 0);
  ASSERT_EQ(told.size(), 1u);
  EXPECT_EQ(told[0].rfind(
                (folder.path() / "new").string() + " is held by process " + std::to_string(child) + " (", 0),
            0u)
      << told[0];
  EXPECT_NE(told[0].find("test_record"), std::string::npos) << "its command";
}

TEST(Hash, OfFilesIsTheOneOfZlib) {
  EXPECT_EQ(crc32_of({}), "00000000");
  EXPECT_EQ(crc32_of({"123456789"}), "cbf43926");  // the standard's check value
  EXPECT_EQ(crc32_of({"123", "", "456789"}), "cbf43926");
  EXPECT_EQ(crc32_of({"The quick brown fox jumps over the lazy dog"}), "414fa339");  // python3: zlib.crc32
}

TEST(Hash, DependsOnEveryByte) {
  EXPECT_EQ(hash_of(""), "cbf29ce484222325");   // the published offset basis
  EXPECT_EQ(hash_of("a"), "af63dc4c8601ec8c");  // published test vector of FNV-1a
  EXPECT_NE(hash_of("ab"), hash_of("ba"));
}

}  // namespace
}  // namespace testbed::meshing
