#include "meshing/record.h"

#include <cassert>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <regex>
#include <sstream>
#include <stdexcept>
#include <thread>
#include <vector>

#include "meshing/files.h"

namespace testbed {

namespace fs = std::filesystem;

namespace {

/// run.json goes first: what is left of an interrupted removal is no result.
void remove_older_run(const fs::path& folder) {
  for (const char* name : {"run.json", "frames.pvd", "curves.csv"}) fs::remove(folder / name);
  static const std::regex kFrame("frame_[0-9]{6,}\\.vtu(\\.tmp)?");
  std::vector<fs::path> frames;
  for (const auto& entry : fs::directory_iterator(folder / "frames"))
    if (std::regex_match(entry.path().filename().string(), kFrame)) frames.push_back(entry.path());
  for (const fs::path& frame : frames) fs::remove(frame);
}

}  // namespace

Recorder::Recorder(fs::path folder, std::vector<CellBlock> cells, int n_surface)
    : folder_(std::move(folder)), cells_(std::move(cells)), n_surface_(n_surface) {
  fs::create_directories(folder_ / "frames");
  remove_older_run(folder_);
}

void Recorder::add_frame(double time, const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xd& u,
                         const std::vector<Field>& fields) {
  char name[32];
  std::snprintf(name, sizeof name, "frames/frame_%06zu.vtu", frames_.size());
  std::vector<Field> all{{"displacement", u}};
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
  std::vector<std::string> columns;
  std::string line;
  for (const auto& [name, value] : row) {
    if (!std::isfinite(value))
      throw std::runtime_error((folder_ / "curves.csv").string() + ": " + name +
                               " is not finite, expected a number");
    char text[32];
    line +=
        (columns.empty() ? "" : ",") + std::string(text, std::to_chars(text, text + sizeof text, value).ptr);
    columns.push_back(name);
  }
  assert(columns_.empty() || columns_ == columns);
  columns_ = std::move(columns);
  rows_ += line + "\n";
}

namespace {

/// Largest resident memory of this process so far (byte); unlike getrusage's, not that of who started it.
double peak_memory() {
  std::istringstream status(fs::exists("/proc/self/status") ? read_file("/proc/self/status") : "");
  for (std::string line; std::getline(status, line);)
    if (line.rfind("VmHWM:", 0) == 0) return 1024 * std::stod(line.substr(6));
  return 0;
}

}  // namespace

void Recorder::finish(nlohmann::ordered_json record) {
  if (!columns_.empty()) {
    std::string header;
    for (const std::string& column : columns_) header += (header.empty() ? "" : ",") + column;
    write_file(folder_ / "curves.csv", header + "\n" + rows_);
  }
  record["peak_memory"] = peak_memory();
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

nlohmann::ordered_json environment_record(const std::string& program, std::optional<int> n_threads) {
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
  nlohmann::ordered_json record{
      {"program", program},
      {"date", date},
      {"program_hash", program_hash()},
      {"compiler", TESTBED_COMPILER},
      {"build", TESTBED_BUILD},
      {"eigen", std::to_string(EIGEN_WORLD_VERSION) + "." + std::to_string(EIGEN_MAJOR_VERSION) + "." +
                    std::to_string(EIGEN_MINOR_VERSION)},
      {"vtk", TESTBED_VTK},
      {"processor", processor},
      {"cores", std::thread::hardware_concurrency()}};
  if (n_threads) record["threads"] = *n_threads;
  return record;
}

namespace {

/// FNV-1a [Fowler, Noll & Vo], continued over more bytes.
struct Fnv1a {
  std::uint64_t hash = 0xcbf29ce484222325u;
  void add(const char* bytes, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i) hash = (hash ^ static_cast<unsigned char>(bytes[i])) * 0x100000001b3u;
  }
  std::string digits() const {
    char text[17];
    std::snprintf(text, sizeof text, "%016lx", hash);
    return text;
  }
};

/// Piece by piece: a program of 80 MB read whole would be most of what a small run takes of memory. A file that
/// is not there counts as empty.
std::string hash_of_file(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::vector<char> piece(1 << 16);
  Fnv1a fnv;
  while (in.read(piece.data(), static_cast<std::streamsize>(piece.size())) || in.gcount() > 0)
    fnv.add(piece.data(), static_cast<std::size_t>(in.gcount()));
  return fnv.digits();
}

}  // namespace

std::string hash_of(const std::string& bytes) {
  Fnv1a fnv;
  fnv.add(bytes.data(), bytes.size());
  return fnv.digits();
}

std::string program_hash() {
  static const std::string hash = [] {
    const fs::path program = "/proc/self/exe", folder = fs::read_symlink(program).parent_path();
    std::string hashes = hash_of_file(program);
    for (const char* worker : {"gmsh_worker", "tetgen_worker"}) hashes += hash_of_file(folder / worker);
    return hash_of(hashes);
  }();
  return hash;
}

bool is_up_to_date(const fs::path& folder, const std::string& input_hash) {
  if (!fs::exists(folder / "run.json")) return false;
  const auto record = nlohmann::json::parse(read_file(folder / "run.json"), nullptr, false);
  return record.is_object() && record.value("status", nlohmann::json()) == "ok" &&
         record.value("input_hash", nlohmann::json()) == input_hash;
}

}  // namespace testbed
