# libmesh_motion_kernels: the loops for evaluation and quality, with the interface include/mesh_motion_kernels.h.
include(GNUInstallDirs)
option(BUILD_SHARED_LIBS "A shared library" ON)

file(GLOB c_interface CONFIGURE_DEPENDS src/c_interface/*.cpp)
add_library(mesh_motion_kernels ${c_interface}
  src/parallel.cpp src/interpolation/cell_lists.cpp src/interpolation/assembly.cpp src/interpolation/summation.cpp
  src/mesh/closest_point.cpp src/mesh/facets.cpp src/mesh/hashed_cells.cpp
  src/quality/cell_quality.cpp src/quality/order_statistics.cpp src/quality/summaries.cpp
  src/interpolation/sparse.cpp src/two_scale/spline.cpp)
list(GET levels 0 narrowest)
compile_for(mesh_motion_kernels ${narrowest})
target_include_directories(mesh_motion_kernels PUBLIC $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/include>
                                                      $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
target_link_libraries(mesh_motion_kernels PRIVATE Threads::Threads)
set_target_properties(mesh_motion_kernels PROPERTIES VISIBILITY_INLINES_HIDDEN ON
                      VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION_MAJOR})

install(TARGETS mesh_motion_kernels DESTINATION ${CMAKE_INSTALL_LIBDIR})
# a Fortran module works with one compiler only: the source is installed, and users compile it with their code
install(FILES include/mesh_motion_kernels.h fortran/mesh_motion_kernels.f90 DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
file(RELATIVE_PATH PREFIX /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
configure_file(mesh_motion_kernels.pc.in mesh_motion_kernels.pc @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/mesh_motion_kernels.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
install(FILES ${CMAKE_CURRENT_SOURCE_DIR}/../LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})
