# Prepares a shell for this repository: heightmap25d, the nodes under install/, colcon.
#   source env.sh        # bash or zsh, from any directory, after `make build`
if [ -n "${ZSH_VERSION:-}" ]; then
  heightmap25d_shell=zsh
  heightmap25d_root=${(%):-%x}
else
  heightmap25d_shell=bash
  heightmap25d_root=${BASH_SOURCE[0]}
fi
heightmap25d_root=$(cd "$(dirname "$heightmap25d_root")" && pwd)

if [ -e "$heightmap25d_root/.venv/packages.key" ] &&
  [ -e "$heightmap25d_root/install/local_setup.$heightmap25d_shell" ]; then
  # The setup scripts of ROS and colcon read variables that are not set.
  case $- in
    *u*) heightmap25d_nounset=-u ;;
    *) heightmap25d_nounset=+u ;;
  esac
  set +u
  . "$heightmap25d_root/scripts/underlay.sh"
  . "$heightmap25d_root/install/local_setup.$heightmap25d_shell"
  set $heightmap25d_nounset
  unset heightmap25d_root heightmap25d_shell heightmap25d_nounset
else
  echo "heightmap25d: not set up yet: make -C $heightmap25d_root build" >&2
  unset heightmap25d_root heightmap25d_shell
  return 1
fi
