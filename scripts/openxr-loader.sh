#!/usr/bin/env bash
# Puts OpenXR's loader for Windows, openxr_loader.dll, into a folder: scripts/openxr-loader.sh FOLDER. It is Khronos'
# (OpenXR-SDK, Apache-2.0 or MIT), as the Python package pyopenxr carries it, whose archive is held to its checksum.
# OPENXR_LOADER=FILE takes another one, such as that of a release of OpenXR-SDK.
set -euo pipefail
folder=${1:?a folder to put openxr_loader.dll into}
package=pyopenxr==1.1.5201
checksum=270a267628ea9958d103d3413ec2f2d44348dad5f85fa4ede6f254380f8c485d
fail() { echo "openxr-loader: $*" >&2; exit 1; }
elsewhere="take it from https://github.com/KhronosGroup/OpenXR-SDK/releases and name it in OPENXR_LOADER"

mkdir -p "$folder"
if [[ -n ${OPENXR_LOADER:-} ]]; then
  cp "$OPENXR_LOADER" "$folder/openxr_loader.dll" || fail "$OPENXR_LOADER cannot be copied"
  exit 0
fi
command -v python3 >/dev/null && python3 -m pip --version >/dev/null 2>&1 ||
  fail "pip, which fetches openxr_loader.dll, is missing (apt install python3-pip); or $elsewhere"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
echo "$package --hash=sha256:$checksum" >"$work/wanted.txt"
python3 -m pip --disable-pip-version-check download --quiet --no-deps --only-binary=:all: --require-hashes \
  --requirement "$work/wanted.txt" --dest "$work" >"$work/said" 2>&1 ||
  fail "$package cannot be fetched ($(tail -n 1 "$work/said")); $elsewhere"
python3 -m zipfile --extract "$work"/pyopenxr-*.whl "$work/unpacked"
cp "$work/unpacked/xr/library/openxr_loader.dll" "$folder/"
