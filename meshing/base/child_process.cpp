#include "meshing/base/child_process.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <ctime>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "meshing/base/files.h"

namespace testbed::meshing {

namespace {

/// Seconds that a process has computed for.
double cpu_seconds(pid_t process) {
  clockid_t clock;
  timespec time{};
  if (clock_getcpuclockid(process, &clock) != 0 || clock_gettime(clock, &time) != 0) return 0;
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// Waits for a process; false when one of its times is over.
bool wait_for(pid_t process, double time_limit, double cpu_limit, int& status) {
  using Clock = std::chrono::steady_clock;
  const auto end = Clock::now() + std::chrono::duration<double>(time_limit);
  std::chrono::milliseconds pause(1);
  while (waitpid(process, &status, WNOHANG) == 0) {
    if (Clock::now() > end || cpu_seconds(process) > cpu_limit) return false;
    std::this_thread::sleep_for(pause);
    pause = std::min(2 * pause, std::chrono::milliseconds(10));
  }
  return true;
}

/// 5, 0.5: as few digits as there are.
std::string text_of(double seconds) {
  std::ostringstream text;
  text << seconds;
  return text.str();
}

}  // namespace

ChildResult run_child(const std::filesystem::path& program, const std::vector<std::string>& arguments,
                      double time_limit, double cpu_limit) {
  const TemporaryFolder folder;
  const std::string log = folder.path() / "log";
  std::vector<std::string> words = arguments;
  words.insert(words.begin(), program.string());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);

  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  pid_t process = 0;
  const int error = posix_spawn(&process, argv[0], &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) throw std::runtime_error(program.string() + ": cannot be started: " + std::strerror(error));

  ChildResult result{false, false, "", ""};
  int status = 0;
  if (!wait_for(process, time_limit, cpu_limit, status)) {
    result.is_stopped = true;
    result.ending =
        "stopped after " + (cpu_seconds(process) > cpu_limit ? text_of(cpu_limit) + " s of computing"
                                                             : text_of(time_limit) + " s");
    kill(process, SIGKILL);
    waitpid(process, &status, 0);
  } else if (WIFSIGNALED(status)) {
    result.ending = "signal " + std::to_string(WTERMSIG(status)) + " (" + strsignal(WTERMSIG(status)) + ")";
  } else {
    result.ending = "status " + std::to_string(WEXITSTATUS(status));
    result.is_success = WEXITSTATUS(status) == 0;
  }
  result.output = read_file(log);
  return result;
}

TemporaryFolder::TemporaryFolder() {
  std::string name = std::filesystem::temp_directory_path() / "testbed-XXXXXX";
  if (!mkdtemp(name.data())) throw std::runtime_error(name + ": folder cannot be made");
  path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

std::filesystem::path program_folder() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path();
}

}  // namespace testbed::meshing
