// A file in memory, for what reads by name.
#pragma once

#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <filesystem>

#include "meshing/base/child_process.h"

namespace testbed {

/// Holds the bytes of the last call. Child processes may read it, too.
inline std::filesystem::path file_of(const std::uint8_t* bytes, size_t n, const std::string& extension) {
  static const int file = memfd_create("bytes", 0);
  static const meshing::TemporaryFolder folder;
  static const std::filesystem::path name = folder.path() / ("bytes" + extension);
  if (!std::filesystem::is_symlink(name))
    std::filesystem::create_symlink("/proc/" + std::to_string(getpid()) + "/fd/" + std::to_string(file),
                                    name);
  if (ftruncate(file, 0) != 0 || pwrite(file, bytes, n, 0) != static_cast<ssize_t>(n)) std::abort();
  return name;
}

}  // namespace testbed
