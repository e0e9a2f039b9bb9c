#!/usr/bin/env bash
# Unpacks further OpenCL drivers for the processor into a folder, without installing anything, so that kernels meet
# other compilers than PoCL's: scripts/opencl-drivers.sh [FOLDER]. FOLDER is target/opencl-drivers by default.
#   FOLDER/rusticl/   Mesa's rusticl on llvmpipe, from Debian 13
#   FOLDER/intel/     Intel's CPU runtime, from PyPI
# Each has a file `environment` for `source`, which shows the program this driver alone. One that cannot be had here
# is told, and left out.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-target/opencl-drivers}
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
. scripts/debian.sh
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
say() { echo "opencl-drivers: $*"; }

clc=/tmp/fov-clc
# Mesa's part in programs, and the libraries that it links.
rusticl() {
  local into=$1 name
  local packages=(mesa-opencl-icd libllvm19 libclang-cpp19 libclang-common-19-dev libllvmspirvlib19.1 libclc-19 libclc-19-dev)
  command -v apt-get >/dev/null && command -v dpkg-deb >/dev/null || { say "rusticl: there is no apt here"; return 1; }
  mkdir "$into/debs"
  list_debian trixie && (cd "$into/debs" && ask download "${packages[@]}") || { say "rusticl: its packages cannot be fetched"; return 1; }
  for name in "$into"/debs/*.deb; do dpkg-deb -x "$name" "$into"; done
  rm -r "$into/debs"
  local libraries=$into/usr/lib/x86_64-linux-gnu
  # Where OpenCL C's own functions are is built into the driver: another path of the same length leads here.
  sed -i --follow-symlinks "s|/usr/lib/clc/|$clc/|g" "$libraries/libRusticlOpenCL.so.1"
  # Its compiler looks for headers beside itself.
  mkdir "$into/usr/lib/lib"
  ln -s ../llvm-19/lib/clang "$into/usr/lib/lib/clang"
  mkdir "$into/vendors"
  echo "$libraries/libRusticlOpenCL.so.1" >"$into/vendors/rusticl.icd"
  cat >"$into/environment" <<END
export OCL_ICD_VENDORS=$into/vendors RUSTICL_ENABLE=llvmpipe
export LD_LIBRARY_PATH=$libraries:$into/usr/lib/llvm-19/lib
ln -sfn "$into/usr/lib/clc" $clc
END
}

# The wheels hold the driver and the libraries that it loads.
intel() {
  local into=$1
  command -v python3 >/dev/null || { say "Intel: there is no python3 here"; return 1; }
  python3 -m pip download -q --no-deps -d "$into/wheels" intel-opencl-rt intel-cmplr-lib-rt tbb tcmlib umf || return 1
  local wheel
  for wheel in "$into"/wheels/*.whl; do python3 -m zipfile -e "$wheel" "$into/unpacked"; done
  rm -r "$into/wheels"
  local driver libraries
  driver=$(find "$into/unpacked" -name libintelocl.so -print -quit)
  [[ -n "$driver" ]] || { say "Intel: the wheel holds no libintelocl.so"; return 1; }
  libraries=$(find "$into/unpacked" -name '*.so*' -printf '%h\n' | sort -u | paste -sd:)
  mkdir "$into/vendors"
  echo "$driver" >"$into/vendors/intel.icd"
  cat >"$into/environment" <<END
export OCL_ICD_VENDORS=$into/vendors
export LD_LIBRARY_PATH=$libraries
END
}

for driver in rusticl intel; do
  [[ ! -e "$folder/$driver/environment" ]] || continue
  rm -rf "${folder:?}/$driver"
  mkdir "$folder/$driver"
  if "$driver" "$folder/$driver"; then
    say "$driver is in $folder/$driver"
  else
    say "$driver is left out"
    rm -rf "${folder:?}/$driver"
  fi
done
