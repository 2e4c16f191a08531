// Whole files in and out.
#pragma once

#include <filesystem>
#include <string>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// The bytes of a file. @throws std::runtime_error when it cannot be read, and for pipes and devices, which may never end.
std::string read_file(const std::filesystem::path& file);

/// Writes `text` to a temporary name beside `file` and
/// renames it, so that a half-written file is never found.
/// @throws std::runtime_error when it cannot be written.
void write_file(const std::filesystem::path& file, const std::string& text);

}  // namespace testbed::meshing
