# 64-bit Arm with Debian's cross compiler and the packages that scripts/arm64-sysroot unpacks; programs run under qemu-user.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)
set(CMAKE_LIBRARY_ARCHITECTURE aarch64-linux-gnu)

set(OCISAC_SYSROOT "${CMAKE_CURRENT_LIST_DIR}/../build/arm64/sysroot" CACHE PATH "Unpacked arm64 packages")
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES OCISAC_SYSROOT)
get_filename_component(ocisac_sysroot "${OCISAC_SYSROOT}" ABSOLUTE)
set(CMAKE_FIND_ROOT_PATH "${ocisac_sysroot}")
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
set(ocisac_arm_libraries "${ocisac_sysroot}/usr/lib/aarch64-linux-gnu")
# Debian keeps BLAS and LAPACK, which OpenCV names, in folders of their own, and zlib in /lib.
set(ocisac_arm_path "${ocisac_arm_libraries}:${ocisac_arm_libraries}/blas:${ocisac_arm_libraries}/lapack")
string(APPEND ocisac_arm_path ":${ocisac_sysroot}/lib/aarch64-linux-gnu")
set(CMAKE_EXE_LINKER_FLAGS_INIT "-Wl,-rpath-link,${ocisac_arm_path}")
set(CMAKE_CROSSCOMPILING_EMULATOR
    qemu-aarch64 -L "${ocisac_sysroot}" -E
    "LD_LIBRARY_PATH=${ocisac_arm_path}")
