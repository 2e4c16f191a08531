// A folder that one process at a time works in.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// Keeps a folder for this process to the end of its life, or of the process, however that ends [flock(2)]. The file
/// `.lock` in the folder names who holds it, or did last. analysis/folder_lock.py does the same.
class FolderLock {
 public:
  /// Makes the folder where it is missing, and waits while another process holds it.
  /// @param tell  is called before, with the folder and "process 12 (massspring a.toml)"
  /// @throws std::runtime_error when the folder cannot be made or written to.
  FolderLock(const std::filesystem::path& folder, const std::function<void(const std::string&)>& tell);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int file_;
};

}  // namespace testbed::meshing
