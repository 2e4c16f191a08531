// Hashes, by which a run knows that it has been done before.
#pragma once

#include <Eigen/Core>
#include <string>
#include <string_view>
#include <vector>

#include "meshing/scene/scene.h"

namespace testbed::meshing {

/// 16 hex digits of a 64-bit hash of bytes.
std::string hash_of(const std::string& bytes);
/// That of nodes' coordinates.
std::string hash_of_nodes(const Eigen::Matrix3Xd& X);

/// 8 hex digits of the CRC-32 of bytes in parts, which zlib of other languages computes, too: of files that are
/// read again, at a gigabyte in a second or two.
std::string crc32_of(const std::vector<std::string_view>& parts);

/// Hash of the running program's executable file and of its workers' beside it, which need not be there: a
/// rebuilt program is a different one.
std::string program_hash();

/// Hash of all that a program's result depends on: the scene less the parts it ignores, the surface, the
/// files of obstacles, the program itself and its meshers.
/// @param ignored  top-level keys of the scene that the program does not read, e.g. {"network"}; name,
/// comparison, playback and output.checkpoint_every never count
std::string input_hash(const Scene& scene, const SurfaceMesh& surface,
                       const std::vector<std::string>& ignored);

}  // namespace testbed::meshing
