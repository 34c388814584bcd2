# A stand-in for that of ESP-IDF: a project has the component main, which is linked with a main().
set(board "${CMAKE_CURRENT_LIST_DIR}/../..")

macro(project name)
  _project(${name} C)
  set(program ${name})
  add_subdirectory(main)
endmacro()

function(idf_component_register)
  cmake_parse_arguments(PARSE_ARGV 0 own "" "" "SRCS;INCLUDE_DIRS")
  add_executable(${program} ${own_SRCS} "${board}/idf_main.c")
  target_include_directories(${program} PRIVATE ${own_INCLUDE_DIRS} "${board}")
  target_compile_definitions(${program} PRIVATE PERIODS=$ENV{PERIODS})
  target_compile_options(${program} PRIVATE -Wall -Wextra -Werror)
endfunction()
