// Whole files in and out.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// The bytes of a file. @throws std::runtime_error when it cannot be read, and for pipes and devices, which may never end.
std::string read_file(const std::filesystem::path& file);

/// Writes `text` to a temporary name beside `file` and
/// renames it, so that a half-written file is never found.
/// @throws std::runtime_error when it cannot be written.
void write_file(const std::filesystem::path& file, const std::string& text);
/// Likewise one part after the other.
void write_file(const std::filesystem::path& file, const std::vector<std::string_view>& parts);

}  // namespace testbed::meshing
