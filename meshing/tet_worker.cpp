// tet_worker MESHER TASK NODES: makes tetrahedra in a process of its own, since meshers crash and hang on
// some surfaces.
#include "meshing/tet_worker.h"

#include <signal.h>
#include <sys/prctl.h>

#include <cstdlib>
#include <iostream>

using namespace testbed;

int main(int argc, char** argv) {
  if (argc != 6) {
    std::cerr
        << "usage: tet_worker gmsh|tetgen ALGORITHM ANGLE_TOLERANCE TASK NODES (started by tetrahedralize)\n";
    return 2;
  }
  prctl(PR_SET_PDEATHSIG, SIGKILL);  // not to outlive the program that waits
  try {
    const TetTask task = read_task(argv[4]);
    write_nodes(argv[5], argv[1] == std::string("gmsh")
                             ? mesh_by_gmsh(task, std::atoi(argv[2]), std::atof(argv[3]))
                             : mesh_by_tetgen(task));
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
