# Prepares a shell (bash or zsh) for what lies under this repository's own packages:
# ROS 2 Jazzy and the Python packages in .venv. Sourced by env.sh and setup.sh with
# heightmap25d_root set.
heightmap25d_venv=$heightmap25d_root/.venv

if [ -d "$heightmap25d_venv/share/rclpy" ]; then # ROS came from PyPI into .venv
  heightmap25d_libraries=$(
    find "$heightmap25d_venv"/lib/python3*/site-packages -maxdepth 1 -name 'ros_*.libs' -printf '%p:'
  )
  export AMENT_PREFIX_PATH=$heightmap25d_venv
  export CMAKE_PREFIX_PATH=$heightmap25d_venv
  export LD_LIBRARY_PATH=$heightmap25d_venv/lib:${heightmap25d_libraries%:}
  # LD_LIBRARY_PATH is right, so the wheels need not start Python a second time to set it.
  export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
  unset heightmap25d_libraries
elif [ -z "${ROS_DISTRO:-}" ]; then
  if [ -n "${ZSH_VERSION:-}" ]; then
    . /opt/ros/jazzy/setup.zsh
  else
    . /opt/ros/jazzy/setup.bash
  fi
fi

export VIRTUAL_ENV=$heightmap25d_venv
case ":$PATH:" in
  *":$heightmap25d_venv/bin:"*) ;;
  *) export PATH=$heightmap25d_venv/bin:$PATH ;;
esac
unset heightmap25d_venv
