#!/usr/bin/env bash
# Kernels under Oclgrind (Price and McIntosh-Smith 2015), which interprets them one instruction after the other and tells where
# two work-items touch one place without atomics, at least one of them to write, where one leaves its buffer, and where one
# writes to a buffer that kernels only read: scripts/check-races.sh [FOLDER]. Oclgrind is unpacked into FOLDER,
# target/oclgrind by default, and not installed. It is Debian 12's package; where that cannot be had, nothing runs, and that
# is told.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-target/oclgrind}
foveate=$PWD/${FOVEATE:-target/debug/foveate}
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
say() { echo "check-races: $*"; }

if [[ ! -e "$folder/complete" ]]; then
  rm -rf "$folder"
  mkdir -p "$folder/debs" "$folder/vendors"
  if ! (cd "$folder/debs" && apt-get -qq download oclgrind liboclgrind-21.10 libclang-common-14-dev libllvm14); then
    say "not run: Oclgrind as Debian 12 has it cannot be fetched here"
    exit 0
  fi
  for package in "$folder"/debs/*.deb; do dpkg-deb -x "$package" "$folder"; done
  echo "$folder/usr/lib/oclgrind/liboclgrind-rt-icd.so" >"$folder/vendors/oclgrind.icd"
  touch "$folder/complete"
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# Inlining leaves notes in the text that Oclgrind's interpreter does not know.
export OCLGRIND_BUILD_OPTIONS="-cl-opt-disable -Dalways_inline=" OCLGRIND_DATA_RACES=1 OCLGRIND_LOG=$work/log
export OCL_ICD_VENDORS=$folder/vendors XDG_CACHE_HOME=$work/cache
export LD_LIBRARY_PATH=$folder/usr/lib/x86_64-linux-gnu${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
failed=0

# check WHAT COMMAND...: it succeeds, by Oclgrind, which says nothing.
check() {
  local what=$1 start=$SECONDS
  shift
  : >"$work/log"
  if ! "$@" >"$work/out" 2>&1; then
    say "$what failed:"
    tail -5 "$work/out"
    failed=1
  elif ! grep -q Oclgrind "$work/out"; then
    say "$what ran on another device:"
    tail -5 "$work/out"
    failed=1
  elif grep -q . "$work/log"; then
    say "$what, of $(grep -c 'Kernel: ' "$work/log") messages:"
    head -40 "$work/log"
    failed=1
  else
    say "$what: nothing in $((SECONDS - start)) s"
  fi
}

# Small ones, since a ray takes tens of milliseconds there. Steps of the light's cache are thousands of paths: packets take a
# minute for them, single rays far longer, so theirs are without.
frame() {
  "$foveate" render tests/files/scenes/meshopt.glb --out "$work/picture.png" --width 16 --height 10 --samples 12 --rays 4 "$@"
}
check "a guided frame by single rays" frame --set trace.traversal=single-ray --set trace.indirect=paths
check "one with a bounce by single rays" frame --set trace.traversal=single-ray --bounces 1
check "a frame of k-nearest neighbours by single rays" frame --set trace.traversal=single-ray --reconstruct k-nn
check "a guided frame by packets" frame --set trace.traversal=packet
check "deforming meshes" cargo test -q --test kernels deform::devices_deform_as_the_host_does -- --nocapture
exit "$failed"
