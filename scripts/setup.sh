#!/usr/bin/env bash
# Make .venv and install everything the project needs in it.
# Usage: scripts/setup.sh STAMP    STAMP is written last, so that a broken run is taken up again.
# PYTHON names the interpreter to build on (default: python3).
set -euo pipefail
cd "$(dirname "$0")/.."

stamp=$1
python=${PYTHON:-python3}

fail() {
  echo "setup: $*" >&2
  exit 1
}

# need PACKAGE WHY TEST...: have the Debian package where the test fails without it.
need() {
  local package=$1 why=$2
  shift 2
  "$@" >/dev/null 2>&1 && return
  local as_root=()
  if [ "$(id -u)" -ne 0 ]; then
    sudo -n true 2>/dev/null || fail "$why is missing: run 'sudo apt-get install $package', then make again."
    as_root=(sudo -n)
  fi
  echo "setup: installing the system package $package ($why)"
  "${as_root[@]}" apt-get update -qq
  DEBIAN_FRONTEND=noninteractive "${as_root[@]}" apt-get install -y -qq --no-install-recommends "$package" >/dev/null
  "$@" >/dev/null 2>&1 || fail "$why is still missing after installing $package."
}

case ${ROS_DISTRO:-} in
  '') site=(); ros_wheels=(-r requirements-ros.txt) ;;
  jazzy) site=(--system-site-packages); ros_wheels=() ;;
  *) fail "ROS_DISTRO is '$ROS_DISTRO', but this project needs jazzy: open a shell where no other ROS is sourced." ;;
esac

need python3 'Python 3' command -v "$python"
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
  fail "Python 3.11 or newer is needed, $python is $("$python" -V 2>&1); name another one with PYTHON=... make setup."
need python3-venv "the venv module of $python" "$python" -c 'import ensurepip, venv'
need libusb-1.0-0 'libusb, which Open3D loads,' bash -c '/sbin/ldconfig -p | grep -q libusb-1.0.so'

# .venv may be there from a run with or without ROS: its site setting has to match.
wanted=$([ ${#site[@]} -gt 0 ] && echo true || echo false)
if ! grep -qsx "include-system-site-packages = $wanted" .venv/pyvenv.cfg; then
  echo 'setup: [1/4] making .venv'
  "$python" -m venv --clear "${site[@]}" .venv
fi
pip=(.venv/bin/python -m pip --disable-pip-version-check --no-input install)
if compgen -G '.venv/.ready-*' >/dev/null; then
  # Brought up to date after a change: little to do, and hundreds of lines that say so.
  pip+=(--quiet)
  rm .venv/.ready-*
fi
echo 'setup: [2/4] PyTorch'
"${pip[@]}" -c requirements-build.txt -r requirements-torch.txt
echo 'setup: [3/4] libraries'
"${pip[@]}" -r requirements-build.txt
"${pip[@]}" -c requirements-torch.txt -c requirements-build.txt "${ros_wheels[@]}" \
  -r requirements.txt -r requirements-dev.txt
echo 'setup: [4/4] this project'
packages=()
for manifest in src/*/package.xml; do
  packages+=(-e "$(dirname "$manifest")")
done
# PEP 517, as the older `setup.py develop` would put the commands where colcon wants them.
"${pip[@]}" --quiet --use-pep517 --no-build-isolation --no-deps "${packages[@]}"
touch "$stamp"
echo 'setup: done'
