#include "meshing/base/files.h"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace testbed::meshing {

std::string read_file(const std::filesystem::path& file) {
  std::ifstream in;
  std::error_code ignored;
  if (std::filesystem::is_regular_file(file, ignored)) in.open(file, std::ios::binary);
  if (!in.is_open()) throw std::runtime_error(file.string() + ": cannot be read, expected a file");
  std::ostringstream text;
  text << in.rdbuf();
  return std::move(text).str();
}

void write_file(const std::filesystem::path& file, const std::string& text) {
  write_file(file, std::vector<std::string_view>{text});
}

void write_file(const std::filesystem::path& file, const std::vector<std::string_view>& parts) {
  const std::filesystem::path temporary = file.string() + ".tmp";
  errno = 0;
  std::ofstream out(temporary, std::ios::binary);
  for (const std::string_view part : parts) out << part;
  out.close();
  if (!out) throw std::runtime_error(temporary.string() + ": cannot be written: " + std::strerror(errno));
  std::filesystem::rename(temporary, file);
}

}  // namespace testbed::meshing
