#include "meshing/record.h"

#include <cassert>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "meshing/files.h"

namespace testbed {

namespace fs = std::filesystem;

Recorder::Recorder(fs::path folder, std::vector<CellBlock> cells, int n_surface)
    : folder_(std::move(folder)), cells_(std::move(cells)), n_surface_(n_surface) {
  fs::create_directories(folder_);
  for (const char* mine : {"run.json", "frames.pvd", "curves.csv", "frames"}) fs::remove_all(folder_ / mine);
  fs::create_directory(folder_ / "frames");
}

void Recorder::add_frame(double time, const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xd& u,
                         const std::vector<Field>& fields) {
  char name[32];
  std::snprintf(name, sizeof name, "frames/frame_%06zu.vtu", frames_.size());
  std::vector<Field> all{
      {"displacement", u},
      {"node_id", Eigen::RowVectorXd::LinSpaced(X.cols(), 0, static_cast<double>(X.cols() - 1))}};
  all.insert(all.end(), fields.begin(), fields.end());
  write_vtu(folder_ / name, X + u, cells_, all, {{"TimeValue", time}, {"n_surface", n_surface_}});
  frames_.emplace_back(time, name);

  std::ostringstream pvd;
  pvd.precision(17);
  pvd << "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n  <Collection>\n";
  for (const auto& [t, file] : frames_)
    pvd << "    <DataSet timestep=\"" << t << "\" group=\"\" part=\"0\" file=\"" << file << "\"/>\n";
  pvd << "  </Collection>\n</VTKFile>\n";
  write_file(folder_ / "frames.pvd", pvd.str());
}

void Recorder::add_row(const std::vector<std::pair<std::string, double>>& row) {
  const bool is_first = columns_.empty();
  std::string line;
  for (size_t c = 0; c < row.size(); ++c) {
    const auto& [name, value] = row[c];
    if (is_first) columns_.push_back(name);
    assert(columns_[c] == name && columns_.size() >= row.size());
    if (!std::isfinite(value))
      throw std::runtime_error((folder_ / "curves.csv").string() + ": " + name +
                               " is not finite, expected a number");
    char text[32];
    line += (c ? "," : "") + std::string(text, std::to_chars(text, text + sizeof text, value).ptr);
  }
  rows_ += line + "\n";
}

void Recorder::finish(const nlohmann::ordered_json& record) {
  if (!columns_.empty()) {
    std::string header;
    for (const std::string& column : columns_) header += (header.empty() ? "" : ",") + column;
    write_file(folder_ / "curves.csv", header + "\n" + rows_);
  }
  write_file(folder_ / "run.json", record.dump(2) + "\n");
}

void StageTimer::start(const std::string& stage) {
  stop();
  current_ = stage;
  since_ = Clock::now();
}

void StageTimer::stop() {
  if (current_.empty()) return;
  const double seconds = std::chrono::duration<double>(Clock::now() - since_).count();
  for (auto& [name, total] : stages_)
    if (name == current_) {
      total += seconds;
      current_.clear();
      return;
    }
  stages_.emplace_back(current_, seconds);
  current_.clear();
}

nlohmann::ordered_json StageTimer::seconds() const {
  nlohmann::ordered_json json;
  for (const auto& [name, total] : stages_) json[name] = total;
  return json;
}

nlohmann::ordered_json environment_record(const std::string& program) {
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
          {"compiler", "g++ " __VERSION__},
          {"build", TESTBED_BUILD},
          {"eigen", std::to_string(EIGEN_WORLD_VERSION) + "." + std::to_string(EIGEN_MAJOR_VERSION) + "." +
                        std::to_string(EIGEN_MINOR_VERSION)},
          {"processor", processor},
          {"cores", std::thread::hardware_concurrency()}};
}

std::string hash_of(const std::string& bytes) {
  // FNV-1a [Fowler, Noll & Vo].
  std::uint64_t hash = 0xcbf29ce484222325u;
  for (const char c : bytes) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3u;
  char text[17];
  std::snprintf(text, sizeof text, "%016lx", hash);
  return text;
}

std::string program_hash() {
  static const std::string hash = hash_of(read_file("/proc/self/exe"));
  return hash;
}

bool is_up_to_date(const fs::path& folder, const std::string& input_hash) {
  if (!fs::exists(folder / "run.json")) return false;
  const auto record = nlohmann::json::parse(read_file(folder / "run.json"), nullptr, false);
  return record.is_object() && record.value("status", "") == "ok" &&
         record.value("input_hash", "") == input_hash;
}

}  // namespace testbed
