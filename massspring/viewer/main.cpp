// The engine of a preview: a Simulation that steps in a thread of its own, spoken to by lines on stdin.
#include <CLI/CLI.hpp>
#include <condition_variable>
#include <deque>
#include <functional>
#include <iostream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "massspring/calibrations/calibrate.h"
#include "massspring/choices/check_model.h"
#include "massspring/choices/paper.h"
#include "massspring/simulation.h"
#include "meshing/base/files.h"
#include "meshing/network/build_network.h"
#include "meshing/run/exit_status.h"
#include "meshing/scene/check.h"
#include "meshing/surface/surface.h"

namespace testbed::massspring {
namespace {

using Clock = std::chrono::steady_clock;
using Json = nlohmann::ordered_json;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

/// A scene with values that are set one after the other, each as --set has it.
struct Values {
  std::string file;
  std::vector<std::string> overrides;

  Scene scene() const {
    Scene scene = read_scene(file, overrides);
    if (scene.is_paper) set_paper_method(scene);
    check_scene(scene, file);
    check_model(scene, scene.network.calibration, file);
    return scene;
  }
};

SpringNetwork network_of(const Scene& scene) {
  const Calibration& calibration = find_calibration(scene.network.calibration);
  const bool needs_links = calibration.needs_links || scene.network.link_share > 0;
  const SurfaceMesh surface = load_surface(scene.surface);
  return build_network(needs_links ? surface : cut_for(scene, surface).surface, scene.network, needs_links,
                       calibration.needs_tetrahedra);
}

template <class Matrix>
void write_values(std::ostream& to, const Matrix& values) {
  const Eigen::MatrixXf narrow = values.template cast<float>();
  to.write(reinterpret_cast<const char*>(narrow.data()),
           static_cast<std::streamsize>(narrow.size() * sizeof(float)));
}

/// What a window is told once of a body at rest.
struct Body {
  Json head;
  std::string values;
};

std::shared_ptr<const Body> body_of(const Simulation& simulation, const SpringNetwork& network) {
  const MassSpringModel& model = simulation.model();
  const Eigen::Matrix3Xd& X = model.network.X;
  const Eigen::Matrix3Xi& F = model.network.F;
  const Eigen::Matrix4Xi& T = model.network.T;
  const Eigen::Matrix2Xi springs = model.springs ? model.springs->E : Eigen::Matrix2Xi();
  const Eigen::Index n_uncut = network.cuts.F.size() > 0 ? network.cuts.F.maxCoeff() + 1 : network.n_surface;
  std::ostringstream values;
  write_values(values, X);
  write_values(values, F);
  write_values(values, springs);
  write_values(values, T);
  return std::make_shared<Body>(Body{{{"n_nodes", X.cols()},
                                      {"n_surface", network.n_surface},
                                      {"n_uncut", n_uncut},  // before triangles were cut: regions hold these
                                      {"n_triangles", F.cols()},
                                      {"n_springs", springs.cols()},
                                      {"n_tetrahedra", T.cols()},
                                      {"is_static", simulation.is_static()}},
                                     values.str()});
}

/// What a window shows of a moment.
struct Picture {
  std::shared_ptr<const Body> body;
  Json head;
  Eigen::Matrix3Xd u, v;  ///< of all nodes (m, m/s)
};

class Preview {
 public:
  explicit Preview(Values values) {
    values.overrides.emplace_back("events=[]");  // the hand at the window makes them
    const Scene scene = values.scene();
    if (scene.places.count("material.law") == 0 && law_of(scene) == MaterialLaw::SmallStrain)
      values.overrides.emplace_back("material.law=neo_hookean");  // and moves the body far
    begin(std::move(values));
    publish();
  }

  /// Answers until stdin ends.
  void listen() {
    std::thread([this] { step_until_the_end(); }).detach();  // a step that takes long holds up no answer
    for (std::string line; std::getline(std::cin, line);) {
      if (line == "picture") {
        show();
        continue;
      }
      const std::scoped_lock lock(mutex_);
      // A hand that moves faster than steps are taken pulls from where it is, not from where it was.
      if (!commands_.empty() && is_of_one_key(commands_.back(), line)) commands_.pop_back();
      commands_.push_back(line);
      is_told_.notify_one();
    }
  }

 private:
  /// Whether both set a value of the same key.
  static bool is_of_one_key(const std::string& a, const std::string& b) {
    return a.rfind("set ", 0) == 0 && a.substr(0, a.find('=')) == b.substr(0, b.find('='));
  }

  void show() {
    const std::scoped_lock lock(mutex_);
    const bool is_new = picture_.body != told_;
    picture_.head["body"] = is_new ? picture_.body->head : Json();
    picture_.head["task"] = task_;
    picture_.head["busy"] = task_.empty() ? 0 : seconds_since(busy_since_);
    picture_.head["message"] = message_;
    std::cout << picture_.head.dump(-1, ' ', false, Json::error_handler_t::replace) << '\n';
    if (is_new) std::cout << picture_.body->values;
    told_ = picture_.body;
    write_values(std::cout, picture_.u);
    write_values(std::cout, picture_.v);
    std::cout.flush();
    is_wanted_ = true;
  }

  void publish() {
    const Snapshot snapshot = simulation_->snapshot();
    const State& state = simulation_->state();
    const TetMesh& network = simulation_->model().network;
    Picture picture;
    picture.body = body_;
    picture.u = snapshot.u;
    picture.v = state.v;
    picture.head = {{"time", state.t},
                    {"n_steps", simulation_->n_done()},
                    {"step", simulation_->step()},
                    {"volume", volume(state.x.leftCols(network.n_surface), network.F)},
                    {"kinetic_energy", snapshot.kinetic_energy},
                    {"elastic_energy", snapshot.elastic_energy},
                    {"status", name_of(simulation_->status())},
                    {"reason", simulation_->report().reason},
                    {"is_running", is_running_},
                    {"has_ended", simulation_->has_ended()},
                    {"n_begun", n_begun_},
                    {"scene", to_toml(scene_)}};
    const std::scoped_lock lock(mutex_);
    picture_ = std::move(picture);
    is_wanted_ = false;
  }

  /// A step of time is due once a clock that goes `speed_` times as fast as the wall's has reached it.
  bool is_due() const {
    return simulation_->is_static() ||
           simulation_->state().t - resumed_at_ <= speed_ * seconds_since(resumed_);
  }

  void resume() {
    resumed_ = Clock::now();
    resumed_at_ = simulation_->state().t;
  }

  void step_until_the_end() {
    constexpr auto kNap = std::chrono::milliseconds(2);
    for (;;) {
      std::string command;
      {
        std::unique_lock<std::mutex> lock(mutex_);
        const auto is_told = [this] { return !commands_.empty(); };
        if (!is_running_ || simulation_->has_ended())
          is_told_.wait(lock, is_told);
        else if (!is_due())
          is_told_.wait_for(lock, kNap, is_told);
        if (is_told()) {
          command = std::move(commands_.front());
          commands_.pop_front();
        }
      }
      if (!command.empty()) {
        set_task(command.rfind("begin ", 0) == 0 ? "another body" : "a change");
        obey(command);
        set_task("");
        publish();
      } else if (is_running_ && !simulation_->has_ended() && is_due()) {
        step();
      }
    }
  }

  /// What takes its time from now on; empty: nothing.
  void set_task(const std::string& task) {
    const std::scoped_lock lock(mutex_);
    task_ = task;
    busy_since_ = Clock::now();
  }

  void step() {
    set_task("a step");
    simulation_->advance();
    set_task("");
    bool is_wanted;
    {
      const std::scoped_lock lock(mutex_);
      is_wanted = is_wanted_;
    }
    constexpr double kLate = 0.25;  // s: what cannot keep up goes on from where it is
    if (speed_ * seconds_since(resumed_) > simulation_->state().t - resumed_at_ + kLate * speed_) resume();
    if (is_wanted || simulation_->has_ended()) publish();
  }

  void obey(const std::string& command) {
    const std::size_t blank = command.find(' ');
    const std::string word = command.substr(0, blank);
    const std::string rest = blank == std::string::npos ? "" : command.substr(blank + 1);
    std::string message;
    try {
      if (word == "run") {
        is_running_ = true;
        resume();
      } else if (word == "pause") {
        is_running_ = false;
      } else if (word == "step") {
        is_running_ = false;
        if (!simulation_->has_ended()) step();
      } else if (word == "reset") {
        simulation_->set_state(at_rest_);
        begin_ = scene_;
        resume();
      } else if (word == "speed") {
        speed_ = std::stod(rest);
        resume();
      } else if (word == "set") {
        set(rest);
      } else if (word == "begin") {
        ++n_begun_;
        message = take_first(rest, ", from rest", [this](const std::string& key, const std::string& value) {
          Values values = values_;
          add_override(values.overrides, key, value);
          begin(std::move(values));
        });
      } else if (word == "first") {
        message = take_first(rest, "", [this](const std::string& key, const std::string& value) {
          set(key + "=\"" + value + "\"");
        });
      } else if (word == "save") {
        write_file(rest, to_toml(begin_));
        message = "saved " + rest;
      } else {
        message = "unknown command '" + word + "'";
      }
    } catch (const std::exception& error) {
      message = error.what();
    }
    const std::scoped_lock lock(mutex_);
    message_ = message;
  }

  /// A body at rest. Where that cannot be, all stays as it was.
  void begin(Values values) {
    const Scene scene = values.scene();
    const SpringNetwork network = network_of(scene);
    auto simulation = std::make_unique<Simulation>(scene, network);
    body_ = body_of(*simulation, network);
    at_rest_ = simulation->state();
    simulation_ = std::move(simulation);
    begin_ = scene_ = scene;
    values_ = std::move(values);
    is_running_ = false;
  }

  /// The first of some values of a key that does not refuse the scene: "network.calibration affine moment". Returns
  /// it, how it is taken, and which did.
  /// @throws std::runtime_error where all do
  static std::string take_first(
      const std::string& text, const std::string& how,
      const std::function<void(const std::string& key, const std::string& value)>& take) {
    std::istringstream words(text);
    std::string key, refused;
    words >> key;
    for (std::string value; words >> value;) {
      try {
        take(key, value);
        return value + how + refused;
      } catch (const std::exception& error) {
        std::cerr << "error: " << error.what() << '\n';
        refused += "; " + value + " refuses the scene";
      }
    }
    throw std::runtime_error(refused.substr(2));
  }

  /// Goes on from the state at hand. Where that cannot be, all stays as it was.
  void set(const std::string& text) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos) throw std::runtime_error(text + ": expected key=value");
    const std::string key = text.substr(0, equals), value = text.substr(equals + 1);
    Values values = values_;
    add_override(values.overrides, key, value);
    const Scene scene = values.scene();
    try {
      simulation_->change(scene);
    } catch (const std::exception&) {
      simulation_->change(scene_);
      throw;
    }
    values_ = std::move(values);
    scene_ = scene;
    begin_.events.push_back({simulation_->state().t, key, value});
    resume();
  }

  Values values_;
  Scene scene_;  ///< as it is now
  Scene begin_;  ///< as it was at rest, with all changes since as events
  std::unique_ptr<Simulation> simulation_;
  State at_rest_;
  std::shared_ptr<const Body> body_;
  int n_begun_ = 0;  ///< other bodies that were asked for
  bool is_running_ = false;
  double speed_ = 1;  ///< of the scene's time over the wall's
  Clock::time_point resumed_ = Clock::now();
  double resumed_at_ = 0;  ///< s, of the scene

  std::mutex mutex_;  ///< of what follows
  std::condition_variable is_told_;
  std::deque<std::string> commands_;
  Picture picture_;
  std::shared_ptr<const Body> told_;
  std::string message_, task_;
  bool is_wanted_ = true;
  Clock::time_point busy_since_;
};

}  // namespace
}  // namespace testbed::massspring

int main(int argc, char** argv) {
  using namespace testbed;
  massspring::Values values;
  CLI::App app("Steps a scene as the lines on stdin say; massspring/viewer/preview.py draws it.");
  app.add_option("scene", values.file, "scene file (.toml)")->required();
  app.add_option("--set", values.overrides, "key=value: overrides a key of the scene; may be repeated")
      ->allow_extra_args(false);
  if (const auto status = meshing::parse(app, argc, argv)) return *status;
  try {
    massspring::Preview preview(std::move(values));
    preview.listen();
    std::_Exit(meshing::kSolved);  // whatever step is under way
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << '\n';
    return meshing::kError;
  }
}
