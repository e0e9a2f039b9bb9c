#!/usr/bin/env bash
# Builds PoCL 7.1 with its network driver, client and server (PoCL-R), without LLVM and without any device
# of its own: scripts/build-pocl-remote.sh [FOLDER], by default target/pocl-remote. Afterwards
# FOLDER/pocld serves this machine's OpenCL devices, and FOLDER/vendors is what OCL_ICD_VENDORS of a client
# points to. POCL_SOURCE may name a folder with the source, or a git repository; by default the source is
# Debian's package pocl-source, downloaded into FOLDER without installing anything, or where there is none
# of this version, a clone of PoCL's repository. scripts/pocl-remote.patch is applied to it.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-target/pocl-remote}
version=7.1
repository=https://github.com/pocl/pocl
patch=$PWD/scripts/pocl-remote.patch

for tool in cmake git c++ patch; do
  command -v "$tool" >/dev/null || {
    echo "build-pocl-remote: $tool is missing; run scripts/install-packages.sh remote" >&2; exit 1; }
done
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
code=$folder/source

# Debian's archive, asked with lists and caches of its own: which suites this system uses does not matter.
from_debian() {
  local keys=/usr/share/keyrings/debian-archive-keyring.gpg apt=$folder/apt mirror
  command -v apt-get >/dev/null && [[ -e $keys ]] || return 1
  mirror=$(apt-get indextargets --format '$(REPO_URI)' "Created-By: Packages" | grep -m 1 '/debian/\?$') ||
    mirror=http://deb.debian.org/debian
  mkdir -p "$apt/lists/partial" "$apt/archives/partial"
  printf 'deb [signed-by=%s] %s %s main\n' "$keys" "$mirror" forky "$keys" "$mirror" sid >"$apt/sources.list"
  local options=(-qq -o "Dir::Etc::SourceList=$apt/sources.list" -o Dir::Etc::SourceParts=/dev/null
    -o Dir::Etc::Preferences=/dev/null -o Dir::Etc::PreferencesParts=/dev/null
    -o "Dir::State::Lists=$apt/lists" -o "Dir::Cache=$apt" -o APT::Sandbox::User= -o Acquire::Languages=none)
  (cd "$apt" && apt-get "${options[@]}" update && apt-get "${options[@]}" download "pocl-source=$version-*") \
    >"$apt/log" 2>&1 || return 1
  dpkg-deb -x "$apt"/pocl-source_*.deb "$apt/unpacked" && tar -xf "$apt"/unpacked/usr/src/pocl.tar.* -C "$apt" &&
    mv "$apt/pocl" "$code" && rm -rf "$apt"
}

clone() {
  git -c advice.detachedHead=false clone --quiet --depth 1 --branch "v$version" "$1" "$code"
}

if [[ ! -e "$folder/complete-source" ]]; then
  rm -rf "$code"
  if [[ -f "${POCL_SOURCE:-}/CMakeLists.txt" ]]; then
    cp -r "$POCL_SOURCE" "$code"
  elif [[ -n "${POCL_SOURCE:-}" ]]; then
    clone "$POCL_SOURCE"
  else
    from_debian || clone "$repository"
  fi || {
    echo "build-pocl-remote: PoCL's source cannot be had; fetch PoCL $version elsewhere and name its folder in POCL_SOURCE" >&2
    exit 1; }
  patch --quiet --directory "$code" -p1 <"$patch" || {
    echo "build-pocl-remote: $patch does not fit this source; it is made for PoCL $version" >&2; exit 1; }
  touch "$folder/complete-source"
fi

# Drivers are linked in, so that nothing has to be installed.
cmake -S "$code" -B "$folder/build" -DCMAKE_BUILD_TYPE=Release -DCMAKE_POSITION_INDEPENDENT_CODE=1 \
  -DENABLE_HOST_CPU_DEVICES=0 -DENABLE_LLVM=0 -DENABLE_ICD=1 -DENABLE_LOADABLE_DRIVERS=0 -DENABLE_REMOTE_CLIENT=1 -DENABLE_REMOTE_SERVER=1 \
  -DENABLE_TESTS=0 -DENABLE_EXAMPLES=0 -DENABLE_POCLCC=0 >"$folder/build.log" 2>&1 &&
  cmake --build "$folder/build" --parallel "$(nproc)" >>"$folder/build.log" 2>&1 || {
  tail -n 20 "$folder/build.log" >&2
  echo "build-pocl-remote: the build failed; $folder/build.log has all of it" >&2
  exit 1; }

mkdir -p "$folder/vendors"
ls "$folder"/build/lib/CL/libpocl.so.*.*.* >"$folder/vendors/pocl-remote.icd"
ln -sf build/pocld/pocld "$folder/pocld"
echo "build-pocl-remote: $folder/pocld is the server, OCL_ICD_VENDORS=$folder/vendors is for the client."
