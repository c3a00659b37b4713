# find_package(linkwatch): the target linkwatch::linkwatch.
if(NOT TARGET linkwatch::linkwatch)
  get_filename_component(_linkwatch_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
  add_library(linkwatch::linkwatch SHARED IMPORTED)
  set_target_properties(linkwatch::linkwatch PROPERTIES
    IMPORTED_LOCATION
      "${_linkwatch_prefix}/lib/liblinkwatch_c${CMAKE_SHARED_LIBRARY_SUFFIX}"
    IMPORTED_NO_SONAME TRUE
    INTERFACE_INCLUDE_DIRECTORIES "${_linkwatch_prefix}/include")
  unset(_linkwatch_prefix)
endif()
