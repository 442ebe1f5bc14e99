#!/bin/sh
# Makes FOLDER with include/ and lib/ of ONNX Runtime from package registries: the headers of Debian 13's
# libonnxruntime-dev, unpacked and not installed, and the library of Python's `onnxruntime`, which is newer and takes
# programs of older headers. Needs apt-get and dpkg (Debian 12 and later, with Debian's keys), and that Python package.
#
#     sh get_onnxruntime.sh FOLDER [PYTHON]
#
# Elsewhere: a release archive of ONNX Runtime has include/ and lib/; so has Debian 13 with libonnxruntime-dev in /usr.
set -eu
folder=$1
python=${2:-python3}
case $python in */*) python=$(cd "$(dirname "$python")" && pwd)/$(basename "$python") ;; esac  # the folder changes below

library=$("$python" -c 'import importlib.util, pathlib
spec = importlib.util.find_spec("onnxruntime")
if spec and spec.origin:
    print(*(pathlib.Path(spec.origin).parent / "capi").glob("libonnxruntime.so.*"), sep="\n")')
test -f "$library" || {
    echo "$python has no onnxruntime with a library for Linux; install it by pip, or name another: $0 FOLDER PYTHON" >&2
    exit 1
}

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
mkdir -p "$scratch/lists/partial" "$scratch/archives/partial"
keys=/usr/share/keyrings/debian-archive-keyring.gpg
echo "deb [signed-by=$keys] http://deb.debian.org/debian trixie main" >"$scratch/sources.list"
apt() {
    apt-get -q -o Dir::Etc::SourceList="$scratch/sources.list" -o Dir::Etc::SourceParts=- \
        -o Dir::State::Lists="$scratch/lists" -o Dir::Cache="$scratch" -o APT::Sandbox::User= "$@"
}
cd "$(dirname "$folder")"  # apt-get download writes to the current folder
folder=$(pwd)/$(basename "$folder")
cd "$scratch"
apt update >/dev/null
apt download libonnxruntime-dev >/dev/null
dpkg -x libonnxruntime-dev_*.deb headers

rm -rf "$folder"
mkdir -p "$folder/lib"
cp -r headers/usr/include/onnxruntime "$folder/include"
ln -s "$library" "$folder/lib/libonnxruntime.so.1"
ln -s libonnxruntime.so.1 "$folder/lib/libonnxruntime.so"
