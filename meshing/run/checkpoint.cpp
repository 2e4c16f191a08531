#include "meshing/run/checkpoint.h"

#include <string_view>

#include "meshing/base/archive.h"
#include "meshing/base/files.h"
#include "meshing/run/hash.h"

namespace testbed::meshing {

namespace fs = std::filesystem;

namespace {

constexpr const char* kMark = "testbed checkpoint 2\n";
constexpr std::size_t kCrcDigits = 8;

/// All but the simulation, which follows and may be large.
void archive(Archive& a, Checkpoint& checkpoint) {
  Recorded& recorded = checkpoint.recorded;
  std::string outputs = recorded.outputs.dump();
  std::vector<std::pair<std::string, double>> sums(checkpoint.sums.begin(), checkpoint.sums.end());
  a(recorded.frames, recorded.columns, recorded.rows, outputs, sums);
  recorded.outputs = nlohmann::ordered_json::parse(outputs);
  checkpoint.sums = {sums.begin(), sums.end()};
}

}  // namespace

void write_checkpoint(const fs::path& folder, const std::string& input_hash, Checkpoint checkpoint) {
  Archive to;
  archive(to, checkpoint);
  const std::string head = kMark + input_hash + to.bytes();
  const std::string crc = crc32_of({head, checkpoint.simulation});
  write_file(folder / kCheckpointFile, {head, checkpoint.simulation, crc});
}

std::optional<Checkpoint> stored_checkpoint(const fs::path& folder, const std::string& input_hash) {
  if (!fs::is_regular_file(folder / kCheckpointFile)) return {};
  const std::string text = read_file(folder / kCheckpointFile), head = kMark + input_hash;
  if (text.size() < head.size() + kCrcDigits || text.compare(0, head.size(), head) != 0) return {};
  std::string_view bytes = text;
  const std::string_view crc = bytes.substr(bytes.size() - kCrcDigits);
  bytes.remove_suffix(kCrcDigits);
  if (crc32_of({bytes}) != crc) return {};
  bytes.remove_prefix(head.size());
  Archive from(bytes);
  Checkpoint checkpoint;
  archive(from, checkpoint);
  checkpoint.simulation = from.rest();
  if (!are_frames_whole(folder, checkpoint.recorded)) return {};
  return checkpoint;
}

}  // namespace testbed::meshing
