# OpenCV's core module, and nothing else of OpenCV: the target OpenCVCore::opencv_core. In this order:
#   1. OpenCVCore_LIBRARY, where given: a library file, shared or static. A static one (.a) is linked with what its build
#      put beside it (opencv4/3rdparty), with zlib, threads and dl; OpenCVCore_DEPENDENCIES names whatever else it wants.
#      OpenCVCore_INCLUDE_DIR is the folder that holds opencv2/core.hpp, looked for beside the library when not given;
#   2. the CMake config of a full OpenCV (OpenCV_DIR, CMAKE_PREFIX_PATH or the system's);
#   3. header and library in the usual places: Debian's libopencv-core-dev has no CMake config.
set(OpenCVCore_LIBRARY "" CACHE FILEPATH "OpenCV's core library; empty: looked for")
set(OpenCVCore_DEPENDENCIES "" CACHE STRING "What a static OpenCVCore_LIBRARY wants besides zlib, threads and dl")
mark_as_advanced(OpenCVCore_LIBRARY OpenCVCore_DEPENDENCIES)

set(OpenCVCore_link ${OpenCVCore_LIBRARY})
if(NOT OpenCVCore_LIBRARY)
  find_package(OpenCV QUIET CONFIG COMPONENTS core)
  if(OpenCV_FOUND AND TARGET opencv_core)
    set(OpenCVCore_link opencv_core)
    set(OpenCVCore_config_include_dirs ${OpenCV_INCLUDE_DIRS})
  else()
    find_library(OpenCVCore_FOUND_LIBRARY opencv_core)
    mark_as_advanced(OpenCVCore_FOUND_LIBRARY)
    if(OpenCVCore_FOUND_LIBRARY)
      set(OpenCVCore_link ${OpenCVCore_FOUND_LIBRARY})
    endif()
  endif()
endif()

get_filename_component(OpenCVCore_library_dir "${OpenCVCore_link}" DIRECTORY)
find_path(OpenCVCore_INCLUDE_DIR opencv2/core/version.hpp
          HINTS ${OpenCVCore_config_include_dirs} "${OpenCVCore_library_dir}/../include"
                "${OpenCVCore_library_dir}/../../include"
          PATH_SUFFIXES opencv4 opencv5)
mark_as_advanced(OpenCVCore_INCLUDE_DIR)

if(OpenCVCore_INCLUDE_DIR)
  file(STRINGS "${OpenCVCore_INCLUDE_DIR}/opencv2/core/version.hpp" OpenCVCore_version_lines
       REGEX "^#define CV_VERSION_(MAJOR|MINOR|REVISION) +[0-9]+")
  string(REGEX MATCHALL "[0-9]+" OpenCVCore_version_numbers "${OpenCVCore_version_lines}")
  list(JOIN OpenCVCore_version_numbers "." OpenCVCore_VERSION)
endif()

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(
  OpenCVCore
  REQUIRED_VARS OpenCVCore_link OpenCVCore_INCLUDE_DIR
  VERSION_VAR OpenCVCore_VERSION
  REASON_FAILURE_MESSAGE "on Debian and Ubuntu: apt-get install libopencv-core-dev")

if(OpenCVCore_FOUND AND NOT TARGET OpenCVCore::opencv_core)
  add_library(OpenCVCore::opencv_core INTERFACE IMPORTED)
  target_include_directories(OpenCVCore::opencv_core SYSTEM INTERFACE ${OpenCVCore_INCLUDE_DIR}
                                                                      ${OpenCVCore_config_include_dirs})
  target_link_libraries(OpenCVCore::opencv_core INTERFACE ${OpenCVCore_link})
  if(OpenCVCore_link MATCHES "\\.a$")
    find_package(Threads REQUIRED)
    file(GLOB OpenCVCore_bundled "${OpenCVCore_library_dir}/opencv*/3rdparty/*.a")
    set(OpenCVCore_zlib "")
    if(NOT OpenCVCore_bundled MATCHES "zlib")
      find_library(OpenCVCore_ZLIB z)
      mark_as_advanced(OpenCVCore_ZLIB)
      set(OpenCVCore_zlib ${OpenCVCore_ZLIB})
    endif()
    target_link_libraries(
      OpenCVCore::opencv_core
      INTERFACE ${OpenCVCore_DEPENDENCIES} ${OpenCVCore_bundled} $<$<BOOL:${OpenCVCore_zlib}>:${OpenCVCore_zlib}>
                Threads::Threads ${CMAKE_DL_LIBS})
  endif()
endif()
