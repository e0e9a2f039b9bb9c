#!/usr/bin/env bash
# Builds PoCL 7.1 with its network driver, client and server (PoCL-R), without LLVM and without any device
# of its own: scripts/build-pocl-remote.sh [FOLDER], by default target/pocl-remote. Afterwards
# FOLDER/pocld serves this machine's OpenCL devices, and FOLDER/vendors is what OCL_ICD_VENDORS of a client
# points to. POCL_SOURCE may name a folder with the source, or a git repository; by default it is cloned.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-target/pocl-remote}
version=7.1
source=${POCL_SOURCE:-https://github.com/pocl/pocl}

for tool in cmake git c++; do
  command -v "$tool" >/dev/null || {
    echo "build-pocl-remote: $tool is missing; run scripts/install-packages.sh remote" >&2; exit 1; }
done

mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
if [[ -f "$source/CMakeLists.txt" ]]; then
  code=$source
else
  code=$folder/source
  if [[ ! -f "$code/CMakeLists.txt" ]]; then
    rm -rf "$code"
    git -c advice.detachedHead=false clone --quiet --depth 1 --branch "v$version" "$source" "$code" || {
      echo "build-pocl-remote: PoCL's source cannot be had from $source; fetch it elsewhere and name its folder in POCL_SOURCE" >&2
      exit 1; }
  fi
fi

# Drivers are linked in, so that nothing has to be installed.
cmake -S "$code" -B "$folder/build" -DCMAKE_BUILD_TYPE=Release -DENABLE_HOST_CPU_DEVICES=0 -DENABLE_LLVM=0 \
  -DENABLE_ICD=1 -DENABLE_LOADABLE_DRIVERS=0 -DENABLE_REMOTE_CLIENT=1 -DENABLE_REMOTE_SERVER=1 \
  -DENABLE_TESTS=0 -DENABLE_EXAMPLES=0 -DENABLE_POCLCC=0 >"$folder/build.log" 2>&1 &&
  cmake --build "$folder/build" --parallel "$(nproc)" >>"$folder/build.log" 2>&1 || {
  tail -n 20 "$folder/build.log" >&2
  echo "build-pocl-remote: the build failed; $folder/build.log has all of it" >&2
  exit 1; }

mkdir -p "$folder/vendors"
ls "$folder"/build/lib/CL/libpocl.so.*.*.* >"$folder/vendors/pocl-remote.icd"
ln -sf build/pocld/pocld "$folder/pocld"
echo "build-pocl-remote: $folder/pocld is the server, OCL_ICD_VENDORS=$folder/vendors is for the client."
