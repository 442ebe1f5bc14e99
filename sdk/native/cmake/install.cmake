# What `cmake --install` puts into a prefix.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

install(TARGETS supersampler EXPORT supersampler)
install(FILES include/supersampler.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})

# find_package(supersampler): the target supersampler::supersampler
set(SS_PACKAGE ${CMAKE_INSTALL_LIBDIR}/cmake/supersampler)
install(EXPORT supersampler NAMESPACE supersampler:: DESTINATION ${SS_PACKAGE} FILE supersamplerTargets.cmake)
configure_package_config_file(cmake/supersamplerConfig.cmake.in supersamplerConfig.cmake INSTALL_DESTINATION ${SS_PACKAGE})
write_basic_package_version_file(supersamplerConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/supersamplerConfig.cmake ${CMAKE_CURRENT_BINARY_DIR}/supersamplerConfigVersion.cmake
        DESTINATION ${SS_PACKAGE})

# pkg-config supersampler
if(UNIX)
  file(RELATIVE_PATH SS_PREFIX_FROM_PC /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)  # a prefix may be moved
  if(NOT BUILD_SHARED_LIBS)  # `--static` would choose the static form of all other libraries, too
    set(SS_STATIC_LIBS " -pthread -lm")
    set(SS_STATIC_FLAGS " -DSS_STATIC")
  endif()
  configure_file(cmake/supersampler.pc.in supersampler.pc @ONLY)
  install(FILES ${CMAKE_CURRENT_BINARY_DIR}/supersampler.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
endif()
