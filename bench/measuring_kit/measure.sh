#!/bin/sh
# Measures the GPU of this machine, in at most six minutes and without a network: sh measure.sh [RECORD.json]
# It needs Python of the version that the wheels are for, pip, and a driver with Vulkan. Nothing is installed.
set -e
here=$(cd "$(dirname "$0")" && pwd)
record=${1:-gpu.json}
python=${PYTHON:-python3}
site=$(mktemp -d)
trap 'rm -rf "$site"' EXIT
"$python" -m pip install -q --no-index --no-deps --no-compile --target "$site" "$here"/wheels/*.whl
PYTHONPATH="$site${PYTHONPATH:+:$PYTHONPATH}" "$python" "$site/bin/supersampler" bench device --minutes 4.5 --json "$record"
echo "$record"
