// A program run beside ours, which may crash or never end.
#pragma once

#include <filesystem>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

struct ChildResult {
  bool is_success;     ///< ended by itself with status 0
  bool is_stopped;     ///< killed since its time was over
  std::string ending;  ///< "status 1", "signal 6 (Aborted)", "stopped after 300 s"
  std::string output;  ///< what it wrote to stdout and stderr, of a flood the first megabyte
};

/// What a program should have made is not there, since its time was over.
struct OutOfTime : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Runs a program with arguments, waits for it at most `time_limit` seconds or until it has computed for
/// `cpu_limit` seconds of its own, then kills it.
/// @param memory_limit  of its address space (byte): beyond, its allocations fail
/// @throws std::runtime_error when it cannot be started.
ChildResult run_child(const std::filesystem::path& program, const std::vector<std::string>& arguments,
                      double time_limit, double cpu_limit = std::numeric_limits<double>::infinity(),
                      double memory_limit = std::numeric_limits<double>::infinity());

/// A new folder for temporary files, removed with everything in it at the end of its life. Those of killed processes are
/// removed as the next is made: the lock on a folder ends with its process.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
  int lock_;  ///< descriptor of the folder
};

/// The running program's own folder, where its helpers lie.
std::filesystem::path program_folder();

}  // namespace testbed::meshing
