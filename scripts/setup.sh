#!/usr/bin/env bash
# Sets the repository up: ROS 2 Jazzy (the machine's, or from PyPI), the Python packages
# in .venv, and heightmap25d_msgs and heightmap25d_ros built into install/.
# A step is left out when its inputs have not changed; `make clean` starts over.
#   PYTHON=python3.12 make build    # with that interpreter instead of python3
set -euo pipefail

heightmap25d_root=$(cd "$(dirname "$0")/.." && pwd)
cd "$heightmap25d_root"

fail() {
  echo "heightmap25d: $*" >&2
  exit 1
}

find_ros() { # sets ros to "machine" or "pypi"
  PATH=${PATH//"$heightmap25d_root/.venv/bin:"/} # there where env.sh is sourced
  if [ -n "${ROS_DISTRO:-}" ] && [ "$ROS_DISTRO" != jazzy ]; then
    fail "ROS 2 $ROS_DISTRO is sourced here, but this package is for Jazzy: use a fresh shell"
  elif [ -n "${ROS_DISTRO:-}" ]; then
    ros=machine
  elif [ -e /opt/ros/jazzy/setup.bash ]; then
    ros=machine
    set +u
    . /opt/ros/jazzy/setup.bash
    set -u
  else
    ros=pypi
    unset AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH
  fi
}

find_python() { # sets python; it must be the one that ROS was built for
  local candidate check
  case $ros in
    machine) check='import rclpy' ;;
    pypi) check='import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 14))' ;;
  esac
  for candidate in ${PYTHON:-python3 /usr/bin/python3 python3.13 python3.12 python3.11 python3.10}; do
    if "$candidate" -c "$check" 2> /dev/null; then
      python=$candidate
      return
    fi
  done
  case $ros in
    machine) fail "no python3 here imports rclpy: sudo apt-get install ros-jazzy-ros-base" ;;
    pypi) missing+=("Python 3.10 to 3.14") packages+=(python3 python3-venv python3-dev) ;;
  esac
}

require_machine() { # names everything that is missing in one line, and stops
  local missing=() packages=() version
  find_python
  if [ -n "${python:-}" ]; then
    version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    "$python" -c 'import ensurepip, venv' 2> /dev/null ||
      { missing+=("Python's venv") packages+=("python$version-venv"); }
    [ -e "$("$python" -c 'import sysconfig; print(sysconfig.get_path("include"))')/Python.h" ] ||
      { missing+=(Python.h) packages+=("python$version-dev"); }
  fi
  command -v cc > /dev/null || { missing+=("a C compiler") packages+=(gcc); }
  command -v c++ > /dev/null || { missing+=("a C++ compiler") packages+=(g++); }
  command -v cmake > /dev/null || { missing+=(cmake) packages+=(cmake); }
  command -v git > /dev/null || { missing+=(git) packages+=(git); }
  if [ ${#missing[@]} -gt 0 ]; then
    local list
    printf -v list '%s, ' "${missing[@]}"
    fail "missing: ${list%, }; install with: sudo apt-get install ${packages[*]}"
  fi
  if [ "$ros" = pypi ] && [ "$(uname -m)" != x86_64 ]; then
    fail "without an installed ROS 2 Jazzy this needs x86_64, not $(uname -m): install ros-jazzy-ros-base"
  fi
}

install_packages() { # makes .venv anew
  echo "heightmap25d: installing Python packages into .venv, which takes a minute or so"
  rm -rf .venv build install log
  case $ros in
    machine)
      "$python" -m venv --system-site-packages .venv
      # ROS is compiled against the machine's numpy and generates code with its empy: keep those.
      grep -vE '^(numpy|empy)==' requirements/pins.txt > .venv/pins.txt
      "$python" -c 'from importlib.metadata import version
for name in ("numpy", "empy"):
    print(f"{name}=={version(name)}")' >> .venv/pins.txt
      env --unset=PYTHONPATH .venv/bin/pip install -qq --constraint .venv/pins.txt \
        --requirement requirements/runtime.txt --requirement requirements/simulation.txt \
        --requirement requirements/dev.txt
      ;;
    pypi)
      "$python" -m venv .venv
      cp requirements/pins.txt .venv/pins.txt
      .venv/bin/pip install -qq --constraint .venv/pins.txt --requirement requirements/runtime.txt \
        --requirement requirements/simulation.txt --requirement requirements/dev.txt \
        --requirement requirements/ros.txt
      make_ros_prefix
      ;;
  esac
}

make_ros_prefix() { # of .venv with ROS's wheels in it
  # Their CMake files name the Python of the machine that built them.
  local python_include numpy_include shell
  python_include=$(.venv/bin/python -c 'import sysconfig; print(sysconfig.get_path("include"))')
  numpy_include=$(.venv/bin/python -c 'import numpy; print(numpy.get_include())')
  find .venv/share -name '*.cmake' -exec sed -Ei \
    -e "s#/opt/python/[^/;\"]+/include/python3\.[0-9]+#$python_include#g" \
    -e "s#/opt/python/[^/;\"]+/lib/python3\.[0-9]+/site-packages/numpy/_core/include#$numpy_include#g" {} +
  # What install/setup.bash, or that of a workspace built on top, sources first.
  for shell in sh bash zsh; do
    printf 'heightmap25d_root=%q\n. "$heightmap25d_root/scripts/underlay.sh"\n' \
      "$PWD" > ".venv/local_setup.$shell"
  done
}

build() {
  local paths=(. heightmap25d_msgs)
  if ! .venv/bin/python -c 'import tf2_msgs.msg' 2> /dev/null; then
    .venv/bin/python scripts/write_tf2_msgs.py build/generated/tf2_msgs
    paths+=(build/generated/tf2_msgs)
  fi
  (
    set +u
    . scripts/underlay.sh
    colcon build --base-paths "${paths[@]}"
  )
}

compile_kernels() { # so that the first start of a node is as quick as the others
  echo "heightmap25d: compiling, which takes a minute or so"
  (
    . env.sh
    python scripts/compile_kernels.py
  )
}

once() { # once STAMP KEY COMMAND: runs the command unless the stamp says that it was done
  [ "$(cat "$1" 2> /dev/null)" = "$2" ] && return
  require_machine
  rm -f "$1"
  "$3"
  echo "$2" > "$1"
}

exec 9< . # one set-up at a time
flock 9

find_ros
.venv/bin/python -ISc '' 2> /dev/null || rm -rf .venv # never made, or its Python is gone
packages_key=$({ echo "$ros $PWD"; cat scripts/setup.sh requirements/*.txt; } | sha256sum)
build_key=$(
  {
    echo "$packages_key"
    find config launch rviz -type f 2> /dev/null | sort || true
    cat heightmap25d_msgs/{package.xml,CMakeLists.txt,msg/*,srv/*,action/*}
    cat package.xml setup.py setup.cfg colcon_defaults.yaml scripts/{heightmap25d,write_tf2_msgs.py}
  } | sha256sum
)
once .venv/packages.key "$packages_key" install_packages
once install/build.key "$build_key" build
once install/kernels.key "$build_key" compile_kernels
