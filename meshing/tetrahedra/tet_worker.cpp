// gmsh_worker, tetgen_worker: make tetrahedra in a process of
// their own, since meshers crash and hang on some surfaces.
#include "meshing/tetrahedra/tet_worker.h"

#include <signal.h>
#include <sys/prctl.h>

#include <cstdlib>
#include <iostream>

using namespace testbed::meshing;

int main(int argc, char** argv) {
  if (argc != 5) {
    std::cerr << "usage: " << argv[0]
              << " ALGORITHM ANGLE_TOLERANCE TASK NODES (started by tetrahedralize)\n";
    return 2;
  }
  prctl(PR_SET_PDEATHSIG, SIGKILL);  // not to outlive the program that waits
  try {
    write_nodes(argv[4], mesh_task(read_task(argv[3]), std::atoi(argv[1]), std::atof(argv[2])));
  } catch (const std::string& message) {
    std::cout << "Error   : " << message << std::endl;
    std::_Exit(1);
  } catch (const std::exception& error) {
    std::cout << "Error   : " << error.what() << std::endl;
    std::_Exit(1);
  }
  std::cout.flush();
  std::_Exit(0);  // gmsh's own clearing up is of no use and may crash
}
