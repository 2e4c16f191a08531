#include "meshing/run/record.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <regex>
#include <sstream>
#include <stdexcept>
#include <string_view>
#include <thread>
#include <vector>

#include "meshing/base/files.h"
#include "meshing/run/hash.h"

namespace testbed::meshing {

namespace fs = std::filesystem;

namespace {

/// Whether a file is a frame, also one half written.
bool is_frame(const std::string& name) {
  static const std::regex kFrame(R"(frame_\d{6,}(_\d+)?\.p?vtu(\.tmp)?)");
  return std::regex_match(name, kFrame);
}

/// What run.json says of a file.
nlohmann::ordered_json stamp_of(const std::string& bytes) {
  return {{"bytes", bytes.size()}, {"crc32", crc32_of({bytes})}};
}

bool is_as_written(const fs::path& file, const nlohmann::ordered_json& stamp) {
  std::error_code error;
  return fs::is_regular_file(file, error) && stamp_of(read_file(file)) == stamp;
}

/// Whether every file that the record lists is there as it was written.
bool is_whole(const fs::path& folder, const nlohmann::ordered_json& record) {
  const auto outputs = record.find("outputs");
  if (outputs == record.end() || !outputs->is_object()) return false;
  return std::all_of(outputs->items().begin(), outputs->items().end(), [&](const auto& output) {
    return is_as_written(folder / output.key(), output.value());
  });
}

constexpr std::string_view kListEnd = "  </Collection>\n</VTKFile>\n";

std::string list_row(const std::pair<double, std::string>& frame) {
  std::ostringstream row;
  row.precision(17);
  row << "    <DataSet timestep=\"" << frame.first << "\" group=\"\" part=\"0\" file=\"" << frame.second
      << "\"/>\n";
  return row.str();
}

/// Of frames.pvd.
std::string list_of(const std::vector<std::pair<double, std::string>>& frames) {
  std::string list =
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n  <Collection>\n";
  for (const auto& frame : frames) list += list_row(frame);
  return list.append(kListEnd);
}

/// Of curves.csv.
std::string table_of(const Recorded& recorded) {
  std::string header;
  for (const std::string& column : recorded.columns) header += (header.empty() ? "" : ",") + column;
  return header + "\n" + recorded.rows;
}

}  // namespace

bool are_frames_whole(const fs::path& folder, const Recorded& recorded) {
  return std::all_of(recorded.frames.begin(), recorded.frames.end(), [&](const auto& frame) {
    return is_as_written(folder / frame.second,
                         recorded.outputs.value(frame.second, nlohmann::ordered_json()));
  });
}

void remove_run(const fs::path& folder, const Recorded* kept) {
  for (const char* name : {"run.json", "frames.pvd", "curves.csv"}) fs::remove(folder / name);
  if (!kept) fs::remove(folder / kCheckpointFile);
  std::vector<fs::path> frames;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(folder / "frames", none))
    if (const std::string name = entry.path().filename().string();
        is_frame(name) && !(kept && kept->outputs.contains("frames/" + name)))
      frames.push_back(entry.path());
  for (const fs::path& frame : frames) fs::remove(frame);
}

Recorder::Recorder(fs::path folder, std::vector<CellBlock> cells, int n_surface, const Recorded* before,
                   Piece piece)
    : folder_(std::move(folder)), cells_(std::move(cells)), n_surface_(n_surface), piece_(std::move(piece)) {
  fs::create_directories(folder_ / "frames");
  if (piece_.number == 0) remove_run(folder_, before);
  if (before) recorded_ = *before;
}

const Recorded& Recorder::recorded() {
  end_frame();
  return recorded_;
}

void Recorder::add_frame(double time, const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xd& u,
                         const std::vector<Field>& fields) {
  end_frame();
  char name[32];
  std::snprintf(name, sizeof name, "frames/frame_%06zu", recorded_.frames.size());
  frame_ = {time, name + std::string(piece_.n_pieces > 1 ? ".pvtu" : ".vtu")};
  std::vector<std::string> pieces;
  for (int p = 0; p < piece_.n_pieces && piece_.n_pieces > 1; ++p)
    pieces.push_back(name + ("_" + std::to_string(p) + ".vtu"));
  std::vector<Field> all{{"displacement", u}, {"rest_position", X}};
  all.insert(all.end(), fields.begin(), fields.end());
  is_written_ = std::async(
      std::launch::async, [this, pieces, x = Eigen::Matrix3Xd(X + u), all = std::move(all)]() mutable {
        const std::string& file = pieces.empty() ? frame_.second : pieces[piece_.number];
        nlohmann::ordered_json stamps{
            {file,
             stamp_of(write_vtu(folder_ / file, x, cells_, all,
                                {{"TimeValue", frame_.first}, {"n_surface", n_surface_}}, piece_.node_id))}};
        if (!pieces.empty() && piece_.number == 0)
          stamps[frame_.second] = stamp_of(write_pvtu(folder_ / frame_.second, pieces, all));
        x = {};  // and not when the next frame ends this one
        all = {};
        return stamps;
      });
}

/// Waits for the frame that is being written, and adds it to the list.
void Recorder::end_frame() {
  if (!is_written_.valid()) return;
  recorded_.outputs.update(is_written_.get());
  if (piece_.number > 0) return recorded_.frames.push_back(frame_);
  if (!list_.is_open()) {
    list_.open(folder_ / "frames.pvd", std::ios::binary);
    list_ << list_of(recorded_.frames);
  }
  recorded_.frames.push_back(frame_);
  list_.seekp(-static_cast<std::streamoff>(kListEnd.size()), std::ios::end);
  list_ << list_row(frame_) << kListEnd << std::flush;
}

void Recorder::add_row(const std::vector<std::pair<std::string, double>>& row) {
  for (const auto& [name, value] : row)
    if (!std::isfinite(value))
      throw std::runtime_error((folder_ / "curves.csv").string() + ": " + name +
                               " is not finite, expected a number");
  std::vector<double> values(recorded_.columns.size(), 0);
  for (size_t i = 0; i < row.size(); ++i) {
    const auto& [name, value] = row[i];
    const size_t at = i < recorded_.columns.size() && recorded_.columns[i] == name ? i : column(name);
    values.resize(recorded_.columns.size(), 0);
    values[at] = value;
  }
  std::string line;
  for (const double value : values) {
    char text[32];
    line += (line.empty() ? "" : ",") + std::string(text, std::to_chars(text, text + sizeof text, value).ptr);
  }
  if (!curves_.is_open()) {
    curves_.open(folder_ / "curves.csv", std::ios::binary);
    curves_ << table_of(recorded_);
  }
  recorded_.rows += line + "\n";
  curves_ << line << "\n" << std::flush;
}

/// The place of a column; rows before a new one have zero there.
size_t Recorder::column(const std::string& name) {
  auto& [frames, columns, rows, outputs] = recorded_;
  const auto found = std::find(columns.begin(), columns.end(), name);
  if (found != columns.end()) return found - columns.begin();
  columns.push_back(name);
  for (size_t at = 0; (at = rows.find('\n', at)) != std::string::npos; at += 3) rows.insert(at, ",0");
  if (curves_.is_open()) curves_.close();
  return columns.size() - 1;
}

double peak_memory() {
  std::istringstream status(fs::exists("/proc/self/status") ? read_file("/proc/self/status") : "");
  for (std::string line; std::getline(status, line);)
    if (line.rfind("VmHWM:", 0) == 0) return 1024 * std::stod(line.substr(6));
  return 0;
}

void Recorder::finish(nlohmann::ordered_json record) {
  end_frame();
  const auto write = [&](const char* name, const std::string& text) {
    write_file(folder_ / name, text);
    recorded_.outputs[name] = stamp_of(text);
  };
  if (!recorded_.frames.empty()) write("frames.pvd", list_of(recorded_.frames));
  if (!recorded_.columns.empty()) write("curves.csv", table_of(recorded_));
  record["peak_memory"] = peak_memory();
  record["outputs"].update(recorded_.outputs);
  write_file(folder_ / "run.json", record.dump(2) + "\n");
  if (record["status"] != kStoppedEarly) fs::remove(folder_ / kCheckpointFile);
}

nlohmann::ordered_json environment_record(const std::string& program, int n_threads) {
  std::istringstream cpuinfo(fs::exists("/proc/cpuinfo") ? read_file("/proc/cpuinfo") : "");
  std::string processor = "unknown";
  for (std::string line; std::getline(cpuinfo, line);)
    if (line.rfind("model name", 0) == 0) {
      processor = line.substr(line.find(':') + 2);
      break;
    }
  char date[32];
  const std::time_t now = std::time(nullptr);
  std::strftime(date, sizeof date, "%Y-%m-%dT%H:%M:%SZ", std::gmtime(&now));
  return {{"program", program},
          {"date", date},
          {"program_hash", program_hash()},
          {"compiler", TESTBED_COMPILER},
          {"build", TESTBED_BUILD},
          {"eigen", std::to_string(EIGEN_WORLD_VERSION) + "." + std::to_string(EIGEN_MAJOR_VERSION) + "." +
                        std::to_string(EIGEN_MINOR_VERSION)},
          {"vtk", TESTBED_VTK},
          {"processor", processor},
          {"cores", std::thread::hardware_concurrency()},
          {"threads", n_threads}};
}

nlohmann::ordered_json to_json(const TetQuality& quality) {
  return {{"min_dihedral", quality.min_dihedral},
          {"min_radius_ratio", quality.min_radius_ratio},
          {"mean_radius_ratio", quality.mean_radius_ratio},
          {"n_slivers", quality.n_slivers}};
}

nlohmann::ordered_json to_json(const TetReport& report) {
  nlohmann::ordered_json record{{"mesher", report.mesher}};
  if (!report.failures.empty()) record["meshers_failed"] = report.failures;
  return record;
}

std::optional<nlohmann::ordered_json> stored_record(const fs::path& folder, const std::string& input_hash) {
  if (!fs::is_regular_file(folder / "run.json")) return {};
  auto record = nlohmann::ordered_json::parse(read_file(folder / "run.json"), nullptr, false);
  if (!record.is_object() || !record.contains("status") || !record["status"].is_string() ||
      record["status"] == kStoppedEarly ||
      record.value("input_hash", nlohmann::ordered_json()) != input_hash || !is_whole(folder, record))
    return {};
  return record;
}

}  // namespace testbed::meshing
