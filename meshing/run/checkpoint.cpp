#include "meshing/run/checkpoint.h"

#include "meshing/base/archive.h"
#include "meshing/base/files.h"
#include "meshing/run/hash.h"

namespace testbed::meshing {

namespace fs = std::filesystem;

namespace {

constexpr const char* kMark = "testbed checkpoint 1\n";
constexpr std::size_t kCrcDigits = 8;

void archive(Archive& a, Checkpoint& checkpoint) {
  Recorded& recorded = checkpoint.recorded;
  std::string outputs = recorded.outputs.dump();
  std::vector<std::pair<std::string, double>> sums(checkpoint.sums.begin(), checkpoint.sums.end());
  a(checkpoint.simulation, recorded.frames, recorded.columns, recorded.rows, outputs, sums);
  recorded.outputs = nlohmann::ordered_json::parse(outputs);
  checkpoint.sums = {sums.begin(), sums.end()};
}

}  // namespace

void write_checkpoint(const fs::path& folder, const std::string& input_hash, Checkpoint checkpoint) {
  Archive to;
  archive(to, checkpoint);
  const std::string text = kMark + input_hash + to.bytes();
  write_file(folder / kCheckpointFile, text + crc32_of(text));
}

std::optional<Checkpoint> stored_checkpoint(const fs::path& folder, const std::string& input_hash) {
  if (!fs::is_regular_file(folder / kCheckpointFile)) return {};
  std::string text = read_file(folder / kCheckpointFile);
  const std::string head = kMark + input_hash;
  if (text.size() < head.size() + kCrcDigits || text.compare(0, head.size(), head) != 0) return {};
  const std::string crc = text.substr(text.size() - kCrcDigits);
  text.resize(text.size() - kCrcDigits);
  if (crc32_of(text) != crc) return {};
  Archive from(text.substr(head.size()));
  Checkpoint checkpoint;
  archive(from, checkpoint);
  if (!are_frames_whole(folder, checkpoint.recorded)) return {};
  return checkpoint;
}

}  // namespace testbed::meshing
