#include "meshing/run/hash.h"

#include <array>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <vector>

#include "meshing/base/files.h"
#include "meshing/base/toml.h"

namespace testbed::meshing {

namespace fs = std::filesystem;

namespace {

/// FNV-1a [Fowler, Noll & Vo], continued over more bytes.
struct Fnv1a {
  std::uint64_t hash = 0xcbf29ce484222325u;
  void add(const char* bytes, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i) hash = (hash ^ static_cast<unsigned char>(bytes[i])) * 0x100000001b3u;
  }
  std::string digits() const {
    char text[17];
    std::snprintf(text, sizeof text, "%016lx", hash);
    return text;
  }
};

/// Piece by piece: a program of 80 MB read whole would be most of
/// what a small run takes of memory. A missing file counts as empty.
std::string hash_of_file(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::vector<char> piece(1 << 16);
  Fnv1a fnv;
  while (in.read(piece.data(), static_cast<std::streamsize>(piece.size())) || in.gcount() > 0)
    fnv.add(piece.data(), static_cast<std::size_t>(in.gcount()));
  return fnv.digits();
}

}  // namespace

std::string hash_of(const std::string& bytes) {
  Fnv1a fnv;
  fnv.add(bytes.data(), bytes.size());
  return fnv.digits();
}

std::string hash_of_nodes(const Eigen::Matrix3Xd& X) {
  return hash_of({reinterpret_cast<const char*>(X.data()), X.size() * sizeof(double)});
}

std::string crc32_of(const std::vector<std::string_view>& parts) {
  // Eight bytes at a time: tables[k][b] is what byte b becomes k bytes later.
  static const auto kTables = [] {
    std::array<std::array<std::uint32_t, 256>, 8> tables{};
    for (std::uint32_t b = 0; b < 256; ++b) {
      std::uint32_t c = b;
      for (int bit = 0; bit < 8; ++bit) c = (c & 1 ? 0xedb88320u : 0u) ^ (c >> 1);
      tables[0][b] = c;
    }
    for (size_t k = 1; k < 8; ++k)
      for (size_t b = 0; b < 256; ++b)
        tables[k][b] = tables[0][tables[k - 1][b] & 255] ^ (tables[k - 1][b] >> 8);
    return tables;
  }();
  std::uint32_t crc = 0xffffffffu;
  for (std::string_view bytes : parts) {
    const auto byte = [&](size_t i) { return static_cast<unsigned char>(bytes[i]); };
    for (; bytes.size() >= 8; bytes.remove_prefix(8)) {
      std::uint32_t next = 0;
      for (size_t i = 0; i < 8; ++i) next ^= kTables[7 - i][byte(i) ^ (i < 4 ? (crc >> (8 * i)) & 255 : 0)];
      crc = next;
    }
    for (; !bytes.empty(); bytes.remove_prefix(1)) crc = kTables[0][(crc ^ byte(0)) & 255] ^ (crc >> 8);
  }
  char text[9];
  std::snprintf(text, sizeof text, "%08x", ~crc);
  return text;
}

std::string program_hash() {
  static const std::string kHash = [] {
    const fs::path program = "/proc/self/exe", folder = fs::read_symlink(program).parent_path();
    std::string hashes = hash_of_file(program);
    for (const char* worker : {"gmsh_worker", "tetgen_worker", "vtk_worker"})
      hashes += hash_of_file(folder / worker);
    return hash_of(hashes);
  }();
  return kHash;
}

std::string input_hash(const Scene& scene, const SurfaceMesh& surface,
                       const std::vector<std::string>& ignored) {
  toml::table table = toml::parse(to_toml(scene));
  for (const char* key : {"name", "comparison", "playback"}) table.erase(key);
  for (const std::string& key : ignored) table.erase(key);
  table["output"].as_table()->erase("checkpoint_every");
  std::ostringstream bytes;
  bytes << table;
  bytes.write(reinterpret_cast<const char*>(surface.X.data()), surface.X.size() * sizeof(double));
  bytes.write(reinterpret_cast<const char*>(surface.F.data()), surface.F.size() * sizeof(int));
  for (const Obstacle& obstacle : scene.obstacles)
    if (const auto* mesh = std::get_if<ClosedMesh>(&obstacle.shape)) bytes << read_file(mesh->file);
  bytes << program_hash();
  return hash_of(bytes.str());
}

}  // namespace testbed::meshing
