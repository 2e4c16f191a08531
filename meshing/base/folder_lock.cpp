#include "meshing/base/folder_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>

#include "meshing/base/files.h"

namespace testbed::meshing {
namespace {

/// "process 12 (massspring a.toml)"
std::string this_process() {
  std::string command = read_file("/proc/self/cmdline");
  while (!command.empty() && command.back() == '\0') command.pop_back();
  std::replace(command.begin(), command.end(), '\0', ' ');
  return "process " + std::to_string(getpid()) + " (" + command + ")";
}

}  // namespace

FolderLock::FolderLock(const std::filesystem::path& folder,
                       const std::function<void(const std::string&)>& tell) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw std::runtime_error(folder.string() + ": cannot be made a folder: " + error.message());
  const std::filesystem::path file = folder / ".lock";
  file_ = open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (file_ < 0) throw std::runtime_error(file.string() + ": cannot be written: " + std::strerror(errno));
  if (flock(file_, LOCK_EX | LOCK_NB) != 0) {
    tell(folder.string() + " is held by " + read_file(file));
    while (flock(file_, LOCK_EX) != 0 && errno == EINTR) {
    }
  }
  const std::string holder = this_process();
  if (ftruncate(file_, 0) != 0 ||
      pwrite(file_, holder.data(), holder.size(), 0) != static_cast<ssize_t>(holder.size())) {
    const std::string reason = std::strerror(errno);
    close(file_);
    throw std::runtime_error(file.string() + ": cannot be written: " + reason);
  }
}

FolderLock::~FolderLock() {
  close(file_);
}

}  // namespace testbed::meshing
