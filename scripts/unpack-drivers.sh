#!/usr/bin/env bash
# Unpacks packages of Debian 13 with all that they need, its C library too, into a folder of this user's, and tells
# cargo of them: scripts/unpack-drivers.sh [--tools] [PACKAGE...]. Nothing is installed, no other program sees them, and no
# root is needed. Without packages cargo is told of none. What was unpacked before and serves is not fetched again.
# With --tools these are programs, not drivers: they have a folder of their own, of which cargo is not told.
#
# Libraries of Debian 13 need its C library. So what cargo builds in this checkout names that library's loader and
# this folder (build/drivers.rs), and finds its drivers by the variables below.
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/places.sh
. scripts/debian.sh

say() { echo "unpack-drivers: $*"; }
fail() { echo "unpack-drivers: $*" >&2; exit 1; }
mark="# Written by scripts/unpack-drivers.sh; make uninstall removes it."

folder=$drivers_folder tools=no
if [[ ${1:-} == --tools ]]; then folder=$tools_folder tools=yes; shift; fi

ours() { [[ $(head -n 1 "$cargo_config") == "$mark" ]]; }
if [[ $# -eq 0 ]]; then
  if [[ -e $cargo_config ]] && ours; then
    rm "$cargo_config"
    say "drivers work here without those in $drivers_folder, which are no longer used"
  fi
  exit 0
fi
if [[ $tools == no && -e $cargo_config ]] && ! ours; then
  fail "$cargo_config is not of this script; move it away while drivers are unpacked"
fi

have() { grep -qxF "$1" "$folder/asked" 2>/dev/null; }
wanted=()
for package in "$@"; do have "$package" || wanted+=("$package"); done

fetch() {
  list_debian trixie || fail "see above"
  ask --print-uris -y install "${all[@]}" >"$work/uris"
  say "fetching $(wc -l <"$work/uris") packages of Debian 13, $(awk '{ bytes += $3 } END { printf "%.0f", bytes / 1e6 }' "$work/uris") MB, for ${wanted[*]}"
  ask --download-only -y install "${all[@]}" >/dev/null || fail "not all packages could be fetched; call it again"
}

# What compilers are made of is not loaded, save the headers of the one that PoCL has built in.
needless='^(linux-libc-dev|libc-dev-bin|rpcsvc-proto|cpp-.*|gcc-.*|g\+\+-.*|libgcc-.*-dev|libstdc\+\+-.*-dev|libc6-dev|libcrypt-dev|lib(asan|tsan|lsan|ubsan|hwasan|objc|gprofng).*|iso-codes)_'

unpack() {
  local file name
  mkdir "$work/root"
  for file in "$work"/cache/archives/*.deb; do
    name=$(basename "$file")
    if [[ $name =~ $needless ]]; then continue; fi
    dpkg-deb -x "$file" "$work/root"
    echo "${name%_*.deb}" | sed 's/%3a/:/' >>"$work/root/packages"
  done
  # Manuals and translations; each package's licence stays.
  rm -rf "$work"/root/usr/share/{man,locale,info,lintian,bug} "$work/root/var"
}

# Drivers name their libraries by their whole paths, so that loaders look for them nowhere else.
name_libraries() {
  local root=$1 to=$2 libraries=$2/usr/lib/$triple file path
  for file in "$root"/etc/OpenCL/vendors/*.icd; do
    if [[ -e $file ]]; then sed -i "s|^\(lib\)|$libraries/\1|" "$file"; fi
  done
  for file in "$root"/usr/share/vulkan/icd.d/*.json "$root"/usr/share/vulkan/*_layer.d/*.json "$root"/usr/share/openxr/1/*.json \
    "$root"/usr/share/openxr/1/api_layers/*.d/*.json; do
    [[ -e $file ]] || continue
    path=$(sed -n 's/.*"library_path": *"\([^"]*\)".*/\1/p' "$file")
    case $path in
      /*) path=$to$path ;;
      *) path=$libraries/$(basename "$path") ;;
    esac
    sed -i "s|\(\"library_path\": *\"\)[^\"]*|\1$path|" "$file"
  done
}

# Programs that are not built here start by that loader, and their children know nothing of it.
write_starter() {
  local root=$1 to=$2 program=$3 options=$4
  [[ -e $root/usr/bin/$program ]] || return 0
  mkdir -p "$root/bin"
  printf '#!/bin/sh\nexec %s --library-path %s %s %s "$@"\n' "$to/loader" "$(paths "$root" "$to")" "$to/usr/bin/$program" \
    "$options" >"$root/bin/$program"
  chmod +x "$root/bin/$program"
}

paths() {
  local root=$1 to=$2 folder joined=""
  for folder in "usr/lib/$triple" usr/lib "usr/lib/$triple"/{blas,lapack,pulseaudio}; do
    if [[ -d $root/$folder ]]; then joined+=:$to/$folder; fi
  done
  echo "${joined#:}"
}

if [[ ${#wanted[@]} -gt 0 ]]; then
  mapfile -t all < <({ cat "$folder/asked" 2>/dev/null || true; printf '%s\n' "${wanted[@]}"; } | sort -u)
  mkdir -p "$foveate_data" || fail "$foveate_data cannot be made; name another place in XDG_DATA_HOME"
  work=$(mktemp -d "$foveate_data/new.XXXXXX")
  trap 'rm -rf "$work"' EXIT
  fetch
  unpack
  loader=$(find "$work/root/usr/lib" -type f -name 'ld-linux*.so.*')
  triple=$(basename "$(dirname "$loader")")
  ln -s "${loader#"$work/root/"}" "$work/root/loader"
  name_libraries "$work/root" "$folder"
  paths "$work/root" "$folder" >"$work/root/paths"
  write_starter "$work/root" "$folder" monado-service ""
  # Its firmware is where it does not look for it by itself.
  write_starter "$work/root" "$folder" qemu-system-x86_64 \
    "-L $folder/usr/share/qemu -L $folder/usr/share/seabios -L $folder/usr/lib/ipxe/qemu"
  printf '%s\n' "${all[@]}" >"$work/root/asked"
  rm -rf "$folder"
  mv "$work/root" "$folder"
  say "unpacked into $folder, $(du -sm "$folder" | cut -f1) MB: for foveate alone; make uninstall removes it"
fi
[[ $tools == no ]] || exit 0

# The plain names are for what cargo starts; the others are kept by the program (src/main.rs), which starts without cargo.
variables() {
  echo "FOVEATE_DRIVERS = \"$drivers_folder\""
  if [[ " $* " == *" pocl-opencl-icd "* ]]; then
    for name in OCL_ICD_VENDORS FOVEATE_OCL_ICD_VENDORS; do echo "$name = \"$drivers_folder/etc/OpenCL/vendors\""; done
  fi
  if [[ " $* " == *" mesa-vulkan-drivers "* ]]; then
    for name in VK_DRIVER_FILES FOVEATE_VK_DRIVER_FILES; do echo "$name = \"$drivers_folder/usr/share/vulkan/icd.d/lvp_icd.json\""; done
  fi
  # What tests alone start does not change when less is asked for, or cargo would build anew.
  local layers=$drivers_folder/usr/share/openxr/1/api_layers/explicit.d
  if [[ -d $layers ]]; then echo "XR_API_LAYER_PATH = \"$layers\""; fi
}
{ echo "$mark"; echo "[env]"; variables "$@"; } >"$cargo_config.new"
if cmp -s "$cargo_config.new" "$cargo_config"; then rm "$cargo_config.new"; else mv "$cargo_config.new" "$cargo_config"; fi
