#include "meshing/base/child_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <ctime>
#include <sstream>
#include <stdexcept>

namespace testbed::meshing {

namespace {

/// Seconds that a process has computed for.
double cpu_seconds(pid_t process) {
  clockid_t clock;
  timespec time{};
  if (clock_getcpuclockid(process, &clock) != 0 || clock_gettime(clock, &time) != 0) return 0;
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

constexpr size_t kMostOutput = 1 << 20;

/// What a process writes: both ends of a pipe, of which it inherits the second alone, as stdout and stderr.
class Output {
 public:
  Output() {
    if (pipe2(ends_, O_CLOEXEC) != 0) throw std::runtime_error("no pipe to a program can be made");
    fcntl(ends_[0], F_SETFL, O_NONBLOCK);
  }
  ~Output() {
    close(ends_[0]);
    if (is_open_) close(ends_[1]);
  }
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;
  int inherited() const { return ends_[1]; }
  void close_inherited() {
    close(ends_[1]);
    is_open_ = false;
  }
  /// Waits for more, at most so many milliseconds, and takes a piece of it.
  /// @return its bytes; 0: there is no more
  size_t take(int milliseconds) {
    pollfd waiting{ends_[0], POLLIN, 0};
    poll(&waiting, has_ended_ ? 0 : 1, milliseconds);
    char piece[1 << 16];
    const ssize_t n = read(ends_[0], piece, sizeof piece);
    has_ended_ = n == 0;
    const size_t n_taken = std::max<ssize_t>(n, 0);
    text.append(piece, std::min(n_taken, kMostOutput - text.size()));
    return n_taken;
  }

  std::string text;

 private:
  int ends_[2];
  bool is_open_ = true, has_ended_ = false;
};

/// Waits for a process and takes what it writes; false when one of its times is over.
bool wait_for(pid_t process, double time_limit, double cpu_limit, Output& output, int& status) {
  using Clock = std::chrono::steady_clock;
  const auto end = Clock::now() + std::chrono::duration<double>(time_limit);
  int pause = 1;  // ms
  while (waitpid(process, &status, WNOHANG) == 0) {
    if (Clock::now() > end || cpu_seconds(process) > cpu_limit) return false;
    output.take(pause);
    pause = std::min(2 * pause, 10);
  }
  size_t rest = 0;  // others that hold the pipe may write for ever
  while (rest < kMostOutput) {
    const size_t n = output.take(0);
    if (n == 0) break;
    rest += n;
  }
  return true;
}

/// Removes temporary folders whose processes have ended: nobody locks them. One that is just being made is not locked yet.
void remove_left_folders(const std::filesystem::path& parent, const std::string& prefix) {
  constexpr double kYoung = 60;  // s
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(parent, ignored)) {
    if (entry.path().filename().string().rfind(prefix, 0) != 0) continue;
    const int folder = open(entry.path().c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (folder < 0) continue;
    struct stat found {};
    if (fstat(folder, &found) == 0 && std::difftime(std::time(nullptr), found.st_mtime) > kYoung &&
        flock(folder, LOCK_EX | LOCK_NB) == 0)
      std::filesystem::remove_all(entry.path(), ignored);
    close(folder);
  }
}

/// 5, 0.5: as few digits as there are.
std::string text_of(double seconds) {
  std::ostringstream text;
  text << seconds;
  return text.str();
}

}  // namespace

ChildResult run_child(const std::filesystem::path& program, const std::vector<std::string>& arguments,
                      double time_limit, double cpu_limit, double memory_limit) {
  Output output;
  std::vector<std::string> words = arguments;
  words.insert(words.begin(), program.string());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);

  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, output.inherited(), STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  pid_t process = 0;
  const int error = posix_spawn(&process, argv[0], &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) throw std::runtime_error(program.string() + ": cannot be started: " + std::strerror(error));
  output.close_inherited();
#ifndef __SANITIZE_ADDRESS__  // The sanitizer's shadow alone takes terabytes of address space.
  if (std::isfinite(memory_limit)) {
    const auto bytes = static_cast<rlim_t>(memory_limit);
    const rlimit limit{bytes, bytes};
    prlimit(process, RLIMIT_AS, &limit, nullptr);
  }
#endif

  ChildResult result{false, false, "", ""};
  int status = 0;
  if (!wait_for(process, time_limit, cpu_limit, output, status)) {
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
  result.output = std::move(output.text);
  return result;
}

TemporaryFolder::TemporaryFolder() {
  const std::filesystem::path parent = std::filesystem::temp_directory_path();
  const std::string prefix = "testbed-";
  remove_left_folders(parent, prefix);
  std::string name = parent / (prefix + "XXXXXX");
  if (!mkdtemp(name.data())) throw std::runtime_error(name + ": folder cannot be made");
  path_ = name;
  lock_ = open(name.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  flock(lock_, LOCK_EX | LOCK_NB);
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
  close(lock_);
}

std::filesystem::path program_folder() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path();
}

}  // namespace testbed::meshing
