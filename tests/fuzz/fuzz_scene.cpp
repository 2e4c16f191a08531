// Scenes: each is refused with a message, or written as a scene that is read to the same.
#include "meshing/scene/check.h"
#include "meshing/scene/scene.h"
#include "tests/fuzz/bytes_as_file.h"

using namespace testbed;

namespace {

std::string written(const std::string& text) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(text.data());
  const meshing::Scene scene = meshing::read_scene(file_of(bytes, text.size(), EXTENSION));
  meshing::check_scene(scene, "scene.toml");
  return to_toml(scene);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, size_t n) {
  std::string once;
  try {
    once = written({reinterpret_cast<const char*>(bytes), n});
  } catch (const std::runtime_error& refused) {
    return 0;
  }
  if (written(once) != once) std::abort();
  return 0;
}
