// Makes what fuzzing starts from: FOLDER/EXTENSION/*, of our own shapes and scenes, and the scene's keys as words.
#include <filesystem>
#include <fstream>
#include <iostream>
#include <regex>
#include <set>

#include "meshing/base/files.h"
#include "meshing/scene/scene.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface_io.h"
#include "tests/meshing/surface_files.h"

namespace fs = std::filesystem;
using namespace testbed::meshing;

namespace {

const char* const kTextPly =
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 2\nproperty list uchar int vertex_index\nend_header\n"
    "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n3 0 2 1\n";

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: " << argv[0] << " FOLDER\n";
    return 1;
  }
  const fs::path folder = argv[1];
  for (const char* name : {"obj", "off", "ply", "stl", "vtp", "vtu", "scene"})
    fs::create_directories(folder / name);
  const SurfaceMesh mesh = make_shape("bar", 8);
  for (const char* name : {"obj", "off"}) {
    write_surface(folder / name / (std::string("bar.") + name), mesh);
  }
  write_file(folder / "obj" / "polygon", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1//1 -3 3/2/1 \\\n4\n");
  write_file(folder / "off" / "polygon", "OFF 4 1 0 # counts\n0 0 0\n1 0 0\n1 1 0\n.2 .2 0\n4 0 1 2 3\n");
  write_file(folder / "ply" / "little", ply_of(mesh, false));
  write_file(folder / "ply" / "big", ply_of(mesh, true));
  write_file(folder / "ply" / "text", kTextPly);
  write_file(folder / "stl" / "binary", binary_stl_of(mesh, ""));
  write_file(folder / "stl" / "text", text_stl_of(mesh));
  const std::string corners = "0 2 1 0 1 3 0 3 2 1 2 3", ends = "3 6 9 12";
  write_file(folder / "vtp" / "tetrahedron", vtp_of(corners, ends));
  write_file(folder / "vtu" / "tetrahedron", vtu_of(corners, ends, "5 5 5 5"));

  std::set<std::string> words;
  for (const auto& entry : fs::directory_iterator(SCENE_FOLDER)) {
    if (entry.path().extension() != ".toml") continue;
    const Scene scene = read_scene(entry.path());
    for (const SceneKey& key : keys_of(scene)) words.insert(key.path.substr(key.path.rfind('.') + 1));
    const std::string whole = std::regex_replace(to_toml(scene), std::regex(" *# .*"), "");
    write_file(folder / "scene" / entry.path().stem(), whole);
    write_file(folder / "scene" / (entry.path().stem().string() + "_short"), read_file(entry.path()));
  }
  std::string dictionary;
  for (const std::string& word : words) dictionary += "\"" + word + "\"\n";
  write_file(folder / "words", dictionary);
}
