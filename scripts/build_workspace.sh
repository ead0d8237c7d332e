#!/usr/bin/env bash
# Build the packages with colcon: scripts/build_workspace.sh FOLDER makes FOLDER/build, install and log.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "$1"
cd "$1"
# The interpreter that runs colcon becomes the one that runs the nodes.
exec "$root/.venv/bin/python" -m colcon build --base-paths "$root/src"
