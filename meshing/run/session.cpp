#include "meshing/run/session.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <ctime>
#include <iostream>
#include <sstream>

#include "meshing/base/child_process.h"
#include "meshing/base/files.h"
#include "meshing/run/hash.h"
#include "meshing/scene/check.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_io.h"

namespace testbed::meshing {
namespace {

constexpr const char* kLeastJacobian = "min_J_nodes";  ///< of snapshots; a record has the least of them
const std::string kSeconds = "seconds.";               ///< of a stage, among the sums of a checkpoint

/// Adds to the reason why a run has not converged that a tetrahedron is flat, and what helps.
void blame_flat_tetrahedra(nlohmann::ordered_json& record) {
  constexpr double kFlat = 1e-6;
  const auto tetrahedra = record.find("tetrahedra");
  if (tetrahedra == record.end() || record.value("status", "") != "not_converged") return;
  const double ratio = tetrahedra->at("min_radius_ratio");
  if (ratio >= kFlat) return;
  std::ostringstream reason;
  reason << record.value("reason", "it has not converged")
         << "; the flattest tetrahedron has a radius ratio of " << ratio << ", expected " << kFlat
         << " or more: ./testbed run --remesh makes an even surface";
  record["reason"] = reason.str();
}

}  // namespace

double cpu_time() {
  double sum = 0;
  for (const int who : {RUSAGE_SELF, RUSAGE_CHILDREN}) {
    rusage spent{};
    getrusage(who, &spent);
    for (const timeval& t : {spent.ru_utime, spent.ru_stime})
      sum += static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  }
  return sum;
}

int run_program(CLI::App& app, int argc, char** argv, SessionOptions& options,
                const std::function<ExitStatus()>& run) {
  app.add_option("scene", options.scene, "scene file (.toml)")->required();
  app.add_option("--set", options.overrides, "key=value: overrides a key of the scene; may be repeated")
      ->allow_extra_args(false);
  app.add_flag_callback(
      "--paper", [&options] { options.overrides.emplace_back("paper=true"); },
      "the PCP paper's method as published, whatever the scene's keys say");
  app.add_option("--out", options.out, "output folder")->capture_default_str();
  app.add_option("--frequencies", options.n_frequencies,
                 "also find so many of the lowest natural frequencies (Hz) and write them into run.json")
      ->check(CLI::Range(1, 1000));
  app.add_option(
         "--budget", options.budget,
         "s of wall-clock time after which the run stops with what it has, to go on from there another "
         "time")
      ->check(CLI::PositiveNumber);
  app.add_flag("--quiet", options.is_quiet, "no progress on stderr");
  app.add_flag("--force", options.is_forced, "run even when nothing has changed");
  app.add_flag("--checked", options.is_checked, "the scene has been checked: do not warn of it again");
  app.footer(
      "The output folder gets frames.pvd with frames/*.vtu (ParaView), curves.csv, scene.toml (every key "
      "with\n"
      "its value and meaning) and, last, run.json. A run whose inputs have not changed is not repeated.\n\n" +
      std::string(kExitStatusHelp));
  if (const auto status = parse(app, argc, argv)) return *status;
  try {
    return run();
  } catch (const std::bad_alloc&) {
    end_by(options.scene + ": takes more memory than there is, expected a coarser body or a smaller network");
  } catch (const std::exception& error) {
    end_by(error.what());
  }
}

Session::Session(const std::string& program, const SessionOptions& options, Scene scene, bool is_first,
                 std::function<bool(bool)> of_first)
    : scene(std::move(scene)),
      progress(options.is_quiet || !is_first),
      program_(program),
      file_(options.scene),
      out_(options.out),
      is_forced_(options.is_forced),
      is_quiet_(options.is_quiet),
      is_checked_(options.is_checked),
      finds_frequencies_(options.n_frequencies > 0),
      is_first_(is_first),
      of_first_(std::move(of_first)),
      cpu_begin_(cpu_time()),
      budget_(options.budget, [this] { end_overdue(); }) {
  timer.add("start-up", static_cast<double>(std::clock()) / CLOCKS_PER_SEC);
  if (!is_first) return;
  lock_.emplace(out_, [](const std::string& text) { std::cerr << text << ": waiting for its end\n"; });
  const std::scoped_lock guard(writing_);
  has_folder_ = true;
}

void Session::end_overdue() {
  if (!is_first_) return;  // the end of the first ends all
  const std::scoped_lock guard(writing_);
  if (!may_end_) return;
  std::string where = stage_.empty() ? "waiting for the folder" : "in the stage " + stage_;
  if (const auto n = known_.find("n_steps_done"); n != known_.end())
    where += ", " + std::to_string(n->get<int>()) + " steps done";
  known_["status"] = kStoppedEarly;
  known_["reason"] = "its budget of time was spent " + where;
  int status = kNotOk;
  try {
    if (recorder_)
      recorder_->finish(known_);
    else if (has_folder_)
      write_file(out_ / "run.json", known_.dump(2) + "\n");
    tell(known_);
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << '\n';
    status = kError;
  }
  _exit(status);  // the thread that solves may never end
}

void Session::stop_early(int n, int n_steps) {
  stopped_early_ = "its budget of time was spent after " + std::to_string(n) + " of " +
                   std::to_string(n_steps) + " steps; the same command " +
                   (is_saved_ ? "goes on" : "begins anew");
}

bool Session::needs_checkpoint() const {
  const double every = scene.output.checkpoint_every;
  return recorder_ && every > 0 && std::chrono::duration<double>(Clock::now() - saved_).count() >= every;
}

/// Of the record so far, those of a run that it goes on from included.
std::map<std::string, double> Session::sums() const {
  std::map<std::string, double> sums;
  for (const auto& [stage, seconds] : timer.seconds()) sums[kSeconds + stage] = seconds;
  sums["wall"] = std::chrono::duration<double>(Clock::now() - begin_).count();
  sums["cpu"] = cpu_time() - cpu_begin_;
  for (const char* name : {"wall", "cpu"})
    if (before_) sums[name] += before_->sums.at(name);
  if (const auto least = record.find(kLeastJacobian); least != record.end()) sums[kLeastJacobian] = *least;
  return sums;
}

void Session::save(std::string simulation) {
  saved_ = Clock::now();
  if (!recorder_ || simulation.empty()) return;  // statics and several processes begin anew
  const std::scoped_lock guard(writing_);
  write_checkpoint(out_, hash_, {std::move(simulation), recorder_->recorded(), sums()});
  is_saved_ = true;
}

void Session::write_scene() const {
  write_file(out_ / "scene.toml", to_toml(scene));
}

/// What leads back from the surface to its file: the file's points and triangles, and the vertex of each point.
void Session::write_surface_file() const {
  const std::filesystem::path file = out_ / "surface_file.vtu";
  std::filesystem::remove(file);
  if (scene.surface.file.empty()) return;
  ReadReport read;
  read_surface(scene.surface.file, &read);
  Eigen::Matrix3Xd points(3, read.points.size());
  for (size_t i = 0; i < read.points.size(); ++i) points.col(i) = read.points[i];
  Eigen::Matrix3Xi triangles(3, read.triangles.size());
  for (size_t f = 0; f < read.triangles.size(); ++f) triangles.col(f) = read.triangles[f];
  const Eigen::Map<const Eigen::RowVectorXi> vertices(read.vertices.data(), read.vertices.size());
  write_vtu(file, points, {{5, triangles}}, {{"vertex", vertices.cast<double>()}}, {});
}

ExitStatus Session::tell(const nlohmann::ordered_json& result) const {
  return is_first_ ? tell_status(file_, result) : kSolved;  // one tells it for all
}

ExitStatus Session::refuse(const std::string& reason) {
  const nlohmann::ordered_json refusal{{"status", "not_solved"}, {"reason", reason}};
  if (is_first_) {
    const std::scoped_lock guard(writing_);
    may_end_ = false;
    remove_run(out_);
    write_scene();
    write_file(out_ / "run.json", refusal.dump(2) + "\n");
  }
  return tell(refusal);
}

std::optional<ExitStatus> Session::stored_status(const std::vector<std::string>& ignored,
                                                 const std::string& options) {
  timer.start("mesh");
  surface = load_surface(scene.surface);
  problem_ = discretise(scene, surface);
  check_supports(scene, surface, problem_, file_);
  if (!finds_frequencies_)
    check_motion(scene, surface, file_);
  else if (scene.volume && scene.volume->is_exact)
    throw std::runtime_error(file_ + ": volume.exact = true with --frequencies, expected volume.coefficient");
  load_factor_of(scene);
  timer.stop();  // hashing the program is no part of solving, and takes the longer the larger it is
  if (is_first_ && !is_checked_)
    for (const std::string& warning : warnings_about(scene, surface, file_))
      std::cerr << "warning: " << warning << '\n';
  hash_ = hash_of(input_hash(scene, surface, ignored) + ' ' + options);
  if (!is_first_) return {};
  const std::scoped_lock guard(writing_);
  const auto stored = is_forced_ ? std::nullopt : stored_record(out_, hash_);
  if (!stored) {
    if (!is_forced_) before_ = stored_checkpoint(out_, hash_);
    remove_run(out_, before_ ? &before_->recorded : nullptr);
  }
  write_scene();
  write_surface_file();
  known_ = {{"program", program_}, {"input_hash", hash_}};
  may_end_ = !stored;
  if (!stored) return {};
  return tell(*stored);
}

void Session::start(const std::string& name) {
  {
    const std::scoped_lock guard(writing_);
    stage_ = name;
  }
  timer.start(name);
  progress.stage(program_ + ": " + name);
}

SurfaceMesh Session::cut_surface(const std::function<void(const SurfaceMesh&)>& fill) {
  Eigen::Index n_refused = 0;
  for (const double coarser : {1, 2}) {
    const CutSurface cut = cut_for(scene, surface, coarser);
    if (cut.surface.cuts.F.size() == 0) break;
    if (cut.surface.X.cols() == n_refused) break;  // as many vertices as are allowed, the same as before
    n_refused = cut.surface.X.cols();
    try {
      fill(cut.surface);
      tell(cut);
      return cut.surface;
    } catch (const std::runtime_error& error) {
      record["cuts_refused"].push_back(error.what());
      const bool is_late = dynamic_cast<const OutOfTime*>(&error);
      progress.tell("the surface cut to " + std::to_string(cut.surface.X.cols()) +
                    (is_late ? " vertices cannot be filled in time: it is not cut"
                             : " vertices cannot be filled: it is cut less"));
      if (is_late) break;
    }
  }
  fill(surface);
  return surface;
}

void Session::tell(const CutSurface& found) {
  const auto& [cut, is_bounded] = found;
  if (const auto n_cut = cut.X.cols() - surface.X.cols(); n_cut > 0) record["n_cut"] = n_cut;
  if (is_bounded) record["is_cut_bounded"] = true;
  if (is_bounded && !is_checked_) {
    std::ostringstream text;
    text << "the surface is too thin in parts for surface.across = " << scene.surface.across
         << ": it is cut to " << cut.X.cols() << " vertices and no further";
    progress.tell(text.str());
  }
}

void Session::foresee(Eigen::Index n_nodes, std::optional<double> seconds) {
  constexpr double kLong = 300;  // s
  std::string text = program_ + ": " + std::to_string(n_nodes) + " nodes";
  if (seconds) {
    record["foreseen_seconds"] = *seconds;
    text += ", some " + duration(*seconds);
    if (*seconds > kLong) text += "; ./testbed remesh with --edge makes a coarser surface, which takes less";
  }
  progress.tell(text);
}

void Session::open(const Eigen::Matrix3Xd& X, const SurfaceMesh& solved, std::vector<CellBlock> cells,
                   int n_threads, Piece piece) {
  const auto n_surface = static_cast<int>(solved.X.cols());
  X_ = X;
  solved_ = solved;
  if (is_first_) cells.insert(cells.begin(), CellBlock{5, solved.F});
  const std::scoped_lock guard(writing_);
  recorder_.emplace(out_, std::move(cells), n_surface, before_ ? &before_->recorded : nullptr,
                    std::move(piece));
  nlohmann::ordered_json head = environment_record(program_, n_threads);
  head["name"] = scene.name;
  head["law"] = name_of(law_of(scene));
  head["input_hash"] = hash_;
  head["mesh_hash"] = hash_of_nodes(X);
  head["problem_hash"] = hash_of(bytes_of(problem_));
  head["n_surface"] = n_surface;
  head["n_nodes"] = X.cols();
  head["free_motions"] = nlohmann::json::array();
  const Eigen::MatrixXd motions = free_motions(problem_, surface.X);
  for (const auto& motion : motions.colwise())
    head["free_motions"].push_back(std::vector<double>(motion.begin(), motion.end()));
  record.update(head);
  known_ = record;
  if (!before_) return;
  for (const auto& [name, sum] : before_->sums)
    if (name.rfind(kSeconds, 0) == 0) timer.add(name.substr(kSeconds.size()), sum);
  if (const auto least = before_->sums.find(kLeastJacobian); least != before_->sums.end())
    record[kLeastJacobian] = least->second;
}

bool Session::needs_frame(int n, bool is_last) const {
  const int every = scene.output.frames_every;
  return is_last || (every > 0 && n % every == 0);
}

bool Session::needs_snapshot(int n, bool is_last) const {
  return scene.output.curves || needs_frame(n, is_last);
}

void Session::add(const Snapshot& snapshot, int n, bool is_last) {
  const std::scoped_lock guard(writing_);
  known_["n_steps_done"] = n;
  if (scene.output.curves && is_first_) {
    const Eigen::Matrix3Xd x = solved_.X + snapshot.u.leftCols(solved_.X.cols());
    std::vector<std::pair<std::string, double>> row{
        {"time", snapshot.time},
        {"load_factor", snapshot.load_factor},
        {"volume", volume(x, solved_.F)},
        {"area", area(x, solved_.F)},
        {"kinetic_energy", snapshot.kinetic_energy},
        {"elastic_energy", snapshot.elastic_energy},
        {"max_displacement",
         snapshot.max_displacement ? *snapshot.max_displacement : snapshot.u.colwise().norm().maxCoeff()}};
    row.insert(row.end(), snapshot.strains.begin(), snapshot.strains.end());
    row.insert(row.end(), snapshot.contact.begin(), snapshot.contact.end());
    row.insert(row.end(), snapshot.ledger.begin(), snapshot.ledger.end());
    recorder_->add_row(row);
    for (const auto& [name, value] : snapshot.strains)
      if (name == kLeastJacobian) record[name] = std::min(value, record.value(name, value));
  }
  if (!needs_frame(n, is_last)) return;
  std::vector<Field> all = snapshot.fields;
  all.insert(all.end(), fields.begin(), fields.end());
  recorder_->add_frame(snapshot.time, X_, snapshot.u, all);
}

ExitStatus Session::finish() {
  const std::scoped_lock guard(writing_);
  may_end_ = false;
  for (const auto& [stage, seconds] : timer.seconds()) record["seconds"][stage] = seconds;
  const auto sums = this->sums();
  for (const char* name : {"wall", "cpu"}) record[name] = sums.at(name);
  if (!stopped_early_.empty()) {
    record["status"] = kStoppedEarly;
    record["reason"] = stopped_early_;
  }
  blame_flat_tetrahedra(record);
  if (const double least = record.value(kLeastJacobian, 1.); least <= 0 && is_first_ && !is_quiet_)
    std::cerr << "warning: tetrahedra were turned inside out: det F down to " << least << " at their nodes\n";
  if (recorder_ && is_first_) recorder_->finish(record);
  return tell(record);
}

}  // namespace testbed::meshing
