# Stands in for ament_cmake: what CMakeLists.txt calls of it, with its effect on the installed tree.
macro(ament_export_dependencies)
endmacro()

macro(ament_package)
  install(FILES package.xml DESTINATION "share/${PROJECT_NAME}")
  file(WRITE "${CMAKE_CURRENT_BINARY_DIR}/marker" "")
  install(FILES "${CMAKE_CURRENT_BINARY_DIR}/marker"
    DESTINATION share/ament_index/resource_index/packages RENAME "${PROJECT_NAME}")
endmacro()
