// Surface files of one EXTENSION: each is read to triangles of its points, or refused with the file's name.
#include <Eigen/Core>

#include "meshing/surface/surface_io.h"
#include "tests/fuzz/bytes_as_file.h"

using namespace testbed;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, size_t n) {
  const std::string file = file_of(bytes, n, EXTENSION);
  try {
    const meshing::SurfaceMesh mesh = meshing::read_surface(file);
    const bool is_sound = mesh.X.allFinite() && mesh.F.size() > 0 && mesh.F.minCoeff() >= 0 &&
                          mesh.F.maxCoeff() < mesh.X.cols();
    if (!is_sound) std::abort();
  } catch (const std::runtime_error& refused) {
    if (std::string(refused.what()).rfind(file, 0) != 0) std::abort();
  }
  return 0;
}
