#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <future>

#include "meshing/base/archive.h"
#include "meshing/base/files.h"
#include "meshing/run/budget.h"
#include "meshing/run/checkpoint.h"

namespace testbed::meshing {
namespace {

namespace fs = std::filesystem;
using Eigen::Matrix3Xd;

const std::string kHash = "0123456789abcdef";

class CheckpointTest : public testing::Test {
 protected:
  const fs::path folder = fs::temp_directory_path() / ("checkpoint_" + std::to_string(getpid()));
  const std::vector<CellBlock> cells{{5, Eigen::Vector3i(0, 1, 2)}};
  const Matrix3Xd X = Matrix3Xd::Identity(3, 3);

  void SetUp() override { fs::remove_all(folder); }
  void TearDown() override { fs::remove_all(folder); }

  /// A run of n frames and rows from `before` on.
  void record(Recorder& recorder, int from, int to) {
    for (int i = from; i < to; ++i) {
      recorder.add_frame(i, X, 0.1 * i * X);
      recorder.add_row({{"time", i}, {"volume", 1.0 / (i + 1)}});
    }
  }
};

TEST_F(CheckpointTest, IsReadAsItWasWritten) {
  Recorder recorder(folder, cells, 3);
  record(recorder, 0, 2);
  const std::string simulation("\0bytes\xff", 7);
  write_checkpoint(folder, kHash, {simulation, recorder.recorded(), {{"wall", 1.0 / 3}}});
  const auto read = stored_checkpoint(folder, kHash);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->simulation, simulation);
  EXPECT_EQ(read->recorded.frames, recorder.recorded().frames);
  EXPECT_EQ(read->recorded.columns, recorder.recorded().columns);
  EXPECT_EQ(read->recorded.rows, recorder.recorded().rows);
  EXPECT_EQ(read->recorded.outputs, recorder.recorded().outputs);
  EXPECT_EQ(read->sums.at("wall"), 1.0 / 3);
}

TEST_F(CheckpointTest, OfOtherInputsOrDamagedAnywhereIsNone) {
  Recorder recorder(folder, cells, 3);
  record(recorder, 0, 2);
  write_checkpoint(folder, kHash, {"state", recorder.recorded(), {}});
  EXPECT_FALSE(stored_checkpoint(folder, "fedcba9876543210"));
  const std::string whole = read_file(folder / kCheckpointFile);
  for (size_t i = 0; i < whole.size(); i += 7) {
    std::string damaged = whole;
    damaged[i] ^= 4;
    write_file(folder / kCheckpointFile, damaged);
    EXPECT_FALSE(stored_checkpoint(folder, kHash)) << i;
    write_file(folder / kCheckpointFile, whole.substr(0, i));
    EXPECT_FALSE(stored_checkpoint(folder, kHash)) << i;
  }
  write_file(folder / kCheckpointFile, whole);
  EXPECT_TRUE(stored_checkpoint(folder, kHash));
  write_file(folder / "frames/frame_000001.vtu", "another");
  EXPECT_FALSE(stored_checkpoint(folder, kHash)) << "a frame is not as it was written";
}

TEST_F(CheckpointTest, ARecordGoesOnAndWhatIsYoungerIsDropped) {
  const fs::path whole = folder / "whole", killed = folder / "killed";
  fs::create_directories(folder);
  {
    Recorder recorder(whole, cells, 3);
    record(recorder, 0, 3);
    recorder.finish({{"status", "ok"}});
  }
  {
    Recorder recorder(killed, cells, 3);
    record(recorder, 0, 2);
    write_checkpoint(killed, kHash, {"state", recorder.recorded(), {}});
    record(recorder, 2, 6);
  }
  const auto before = stored_checkpoint(killed, kHash);
  ASSERT_TRUE(before);
  Recorder recorder(killed, cells, 3, &before->recorded);
  EXPECT_TRUE(fs::exists(killed / kCheckpointFile)) << "it may be killed again";
  EXPECT_TRUE(fs::exists(killed / "frames/frame_000001.vtu"));
  EXPECT_FALSE(fs::exists(killed / "frames/frame_000002.vtu"));
  record(recorder, 2, 3);
  recorder.finish({{"status", "ok"}});
  EXPECT_FALSE(fs::exists(killed / kCheckpointFile));
  for (const char* name : {"curves.csv", "frames.pvd", "frames/frame_000002.vtu"})
    EXPECT_EQ(read_file(killed / name), read_file(whole / name)) << name;
}

TEST_F(CheckpointTest, OfARunThatWasStoppedEarlyStaysAndItsRecordIsNeverUpToDate) {
  Recorder recorder(folder, cells, 3);
  record(recorder, 0, 2);
  write_checkpoint(folder, kHash, {"state", recorder.recorded(), {}});
  recorder.finish({{"status", kStoppedEarly}, {"input_hash", kHash}});
  EXPECT_TRUE(stored_checkpoint(folder, kHash));
  EXPECT_FALSE(stored_record(folder, kHash));
  remove_run(folder);
  EXPECT_FALSE(fs::exists(folder / kCheckpointFile));
}

TEST(Archive, GivesBackWhatWasWrittenAndRefusesWhatIsCut) {
  Archive to;
  std::vector<std::pair<double, std::string>> list{{0.1, "a"}, {-0.0, std::string("\0b", 2)}};
  std::optional<std::array<int, 2>> some{{3, -4}}, none;
  Eigen::MatrixXf empty(4, 0), values = Eigen::MatrixXf::Random(4, 3);
  auto shared = std::make_shared<const std::vector<float>>(3, 0.5f);
  std::shared_ptr<const std::vector<float>> null;
  to(list, some, none, empty, values, shared, null);
  Archive from(to.bytes());
  auto list2 = list;
  list2.clear();
  decltype(some) some2, none2 = some;
  Eigen::MatrixXf empty2 = values, values2;
  decltype(null) shared2, null2 = shared;
  from(list2, some2, none2, empty2, values2, shared2, null2);
  EXPECT_EQ(list2, list);
  EXPECT_EQ(some2, some);
  EXPECT_FALSE(none2);
  EXPECT_EQ(empty2.cols(), 0);
  EXPECT_EQ(values2, values);
  EXPECT_EQ(*shared2, *shared);
  EXPECT_FALSE(null2);
  for (size_t n = 0; n < to.bytes().size(); ++n) {
    Archive cut(std::string_view(to.bytes()).substr(0, n));
    EXPECT_THROW(cut(list2, some2, none2, empty2, values2, shared2, null2), std::runtime_error) << n;
  }
}

TEST(Budget, IsSpentAfterItsTimeAndActsWhereNobodyAsks) {
  std::promise<void> acted;
  const Budget endless({}, [&] { acted.set_value(); });
  EXPECT_FALSE(endless.is_spent());
  const Budget long_one(1e3, [&] { acted.set_value(); });
  EXPECT_FALSE(long_one.is_spent());
  const Budget budget(1e-3, [&] { acted.set_value(); });
  const auto future = acted.get_future();
  EXPECT_EQ(future.wait_for(std::chrono::milliseconds(500)), std::future_status::timeout) << "its patience";
  EXPECT_TRUE(budget.is_spent());
  EXPECT_EQ(future.wait_for(std::chrono::seconds(60)), std::future_status::ready);
}

}  // namespace
}  // namespace testbed::meshing
