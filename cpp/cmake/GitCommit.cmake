# git_commit(variable): the short hash of the commit that is built, "unknown" where this is no git checkout of it.
# Configures again when the checkout moves on.
function(git_commit variable)
  set(commit unknown)
  find_program(OCISAC_GIT git)
  mark_as_advanced(OCISAC_GIT)
  if(OCISAC_GIT)
    set(git "${OCISAC_GIT}" -C "${CMAKE_CURRENT_SOURCE_DIR}")
    # An unpacked archive may lie inside some other repository: only one that tracks this very file counts.
    execute_process(COMMAND ${git} ls-files --error-unmatch CMakeLists.txt
                    RESULT_VARIABLE not_tracked OUTPUT_QUIET ERROR_QUIET)
    execute_process(COMMAND ${git} rev-parse --short HEAD RESULT_VARIABLE no_commit OUTPUT_VARIABLE hash
                    OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
    if(NOT not_tracked AND NOT no_commit)
      set(commit "${hash}")
      execute_process(COMMAND ${git} rev-parse --git-path logs/HEAD OUTPUT_VARIABLE moves
                      OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
      get_filename_component(moves "${moves}" ABSOLUTE)
      if(EXISTS "${moves}")
        set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS "${moves}")
      endif()
    endif()
  endif()
  set(${variable} "${commit}" PARENT_SCOPE)
endfunction()
