# Google Highway's library (SIMD chosen at run time), wherever it lies: the target Highway::hwy.
find_path(Highway_INCLUDE_DIR hwy/highway.h)
find_library(Highway_LIBRARY hwy)
mark_as_advanced(Highway_INCLUDE_DIR Highway_LIBRARY)

if(Highway_INCLUDE_DIR)
  file(STRINGS "${Highway_INCLUDE_DIR}/hwy/base.h" Highway_version_lines REGEX "^#define HWY_(MAJOR|MINOR|PATCH) +[0-9]+")
  if(NOT Highway_version_lines) # where newer ones keep it
    file(STRINGS "${Highway_INCLUDE_DIR}/hwy/highway.h" Highway_version_lines
         REGEX "^#define HWY_(MAJOR|MINOR|PATCH) +[0-9]+")
  endif()
  string(REGEX MATCHALL "[0-9]+" Highway_version_numbers "${Highway_version_lines}")
  list(JOIN Highway_version_numbers "." Highway_VERSION)
endif()

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(
  Highway
  REQUIRED_VARS Highway_LIBRARY Highway_INCLUDE_DIR
  VERSION_VAR Highway_VERSION
  REASON_FAILURE_MESSAGE "on Debian and Ubuntu: apt-get install libhwy-dev")

if(Highway_FOUND AND NOT TARGET Highway::hwy)
  add_library(Highway::hwy INTERFACE IMPORTED)
  target_include_directories(Highway::hwy SYSTEM INTERFACE ${Highway_INCLUDE_DIR})
  target_link_libraries(Highway::hwy INTERFACE ${Highway_LIBRARY})
endif()
