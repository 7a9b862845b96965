# OpenCV's core module, and nothing else of OpenCV: OpenCVCore::opencv_core.
# A full OpenCV brings its own CMake config; Debian's libopencv-core-dev alone does not.
find_package(OpenCV QUIET COMPONENTS core CONFIG)
if(OpenCV_FOUND AND TARGET opencv_core)
  set(OpenCVCore_LIBRARY opencv_core)
  set(OpenCVCore_INCLUDE_DIR ${OpenCV_INCLUDE_DIRS})
  set(OpenCVCore_VERSION ${OpenCV_VERSION})
else()
  find_path(OpenCVCore_INCLUDE_DIR opencv2/core.hpp PATH_SUFFIXES opencv4 opencv5)
  find_library(OpenCVCore_LIBRARY opencv_core)
endif()

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(OpenCVCore REQUIRED_VARS OpenCVCore_LIBRARY OpenCVCore_INCLUDE_DIR)

if(OpenCVCore_FOUND AND NOT TARGET OpenCVCore::opencv_core)
  add_library(OpenCVCore::opencv_core INTERFACE IMPORTED)
  target_include_directories(OpenCVCore::opencv_core SYSTEM INTERFACE ${OpenCVCore_INCLUDE_DIR})
  target_link_libraries(OpenCVCore::opencv_core INTERFACE ${OpenCVCore_LIBRARY})
endif()
