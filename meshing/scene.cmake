# The scene file and the record of a run, used by both solvers.
add_library(scene STATIC progress.cpp record.cpp scene.cpp scene_surface.cpp scene_writer.cpp vtu.cpp)
target_link_libraries(scene PUBLIC surface_mesh nlohmann_json::nlohmann_json PRIVATE VTK::IOXML)
string(TOUPPER "${CMAKE_BUILD_TYPE}" build_type)
set_property(
  SOURCE record.cpp
  PROPERTY COMPILE_DEFINITIONS
           "TESTBED_COMPILER=\"${CMAKE_CXX_COMPILER_ID} ${CMAKE_CXX_COMPILER_VERSION}\""
           "TESTBED_BUILD=\"${CMAKE_BUILD_TYPE} ${CMAKE_CXX_FLAGS} ${CMAKE_CXX_FLAGS_${build_type}}\""
           "TESTBED_VTK=\"${VTK_VERSION}\"")
