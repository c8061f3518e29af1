# Stands in for ament_cmake_python.
macro(ament_get_python_install_dir python_install_dir_out)
  set(${python_install_dir_out} "lib/python3/site-packages")
endmacro()
