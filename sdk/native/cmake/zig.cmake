# Cross-compiles with Zig, of PyPI's package ziglang:
#   cmake -S sdk/native -B build -DCMAKE_TOOLCHAIN_FILE=cmake/zig.cmake -DSS_ZIG=/path/of/zig -DSS_TARGET=aarch64-linux-gnu.2.17
# SS_TARGET: CPU-SYSTEM-ABI as `zig cc -target` takes it: {x86_64,aarch64}-{linux-gnu.2.17,linux-musl,macos.11.0,windows-gnu},
# or wasm32-wasi, for browsers.
set(CMAKE_TRY_COMPILE_PLATFORM_VARIABLES SS_ZIG SS_TARGET)
string(REPLACE "-" ";" SS_TARGET_PARTS ${SS_TARGET})
list(GET SS_TARGET_PARTS 0 CMAKE_SYSTEM_PROCESSOR)
list(GET SS_TARGET_PARTS 1 SS_TARGET_SYSTEM)
if(SS_TARGET_SYSTEM MATCHES "^macos")
  set(CMAKE_SYSTEM_NAME Darwin)
elseif(SS_TARGET_SYSTEM STREQUAL windows)
  set(CMAKE_SYSTEM_NAME Windows)
elseif(SS_TARGET_SYSTEM STREQUAL wasi)
  set(CMAKE_SYSTEM_NAME Generic)
else()
  set(CMAKE_SYSTEM_NAME Linux)
endif()
set(CMAKE_C_COMPILER ${SS_ZIG} cc -target ${SS_TARGET})
# `zig c++` would first compile its C++ runtime for the target, which takes minutes and which the library does not need.
set(CMAKE_CXX_COMPILER ${SS_ZIG} cc -target ${SS_TARGET})
set(CMAKE_C_LINKER_DEPFILE_SUPPORTED FALSE)
