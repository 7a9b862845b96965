# The compiler, asked for before CMake stops over several messages: one that says what to install.
include(CheckLanguage)
check_language(CXX)
if(NOT CMAKE_CXX_COMPILER)
  message(FATAL_ERROR "ocisac: no C++ compiler was found. Install one of C++20 (on Debian and Ubuntu: apt-get install g++) or name it: CXX=...")
endif()
enable_language(CXX)
