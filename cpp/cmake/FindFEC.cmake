# libfec's library (Reed–Solomon), wherever it lies: the target FEC::fec. It is under the LGPL: linked as a shared library.
find_path(FEC_INCLUDE_DIR fec.h)
find_library(FEC_LIBRARY NAMES libfec.so fec)
mark_as_advanced(FEC_INCLUDE_DIR FEC_LIBRARY)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(FEC REQUIRED_VARS FEC_LIBRARY FEC_INCLUDE_DIR
                                  REASON_FAILURE_MESSAGE "on Debian and Ubuntu: apt-get install libfec-dev")

if(FEC_FOUND AND NOT TARGET FEC::fec)
  add_library(FEC::fec INTERFACE IMPORTED)
  target_include_directories(FEC::fec SYSTEM INTERFACE ${FEC_INCLUDE_DIR})
  target_link_libraries(FEC::fec INTERFACE ${FEC_LIBRARY})
endif()
