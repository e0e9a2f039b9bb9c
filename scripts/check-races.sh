#!/usr/bin/env bash
# Kernels under Oclgrind (Price and McIntosh-Smith 2015), which interprets them one instruction after the other and tells where
# two work-items touch one place without atomics, at least one of them to write, where one leaves its buffer, and where one
# writes to a buffer that kernels only read: scripts/check-races.sh [FOLDER]. Oclgrind is unpacked into FOLDER/oclgrind,
# in target by default, and not installed. It is Debian 12's package; where that cannot be had, nothing runs, and that
# is told, and is a failure where checks must not be left out (CI=true).
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-target}
foveate=$PWD/${FOVEATE:-target/debug/foveate}
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)/oclgrind
. scripts/debian.sh
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
say() { echo "check-races: $*"; }
leave_out() {
  say "not run: $*"
  if [[ ${CI:-} == true ]]; then exit 1; fi
  exit 0
}

# All that it links save what each system has, so that other releases' libraries are not needed.
common='^(libc6|libgcc-s1|gcc-12-base|libstdc\+\+6|tar|dpkg)_'
if [[ ! -e "$folder/complete" ]]; then
  command -v apt-get >/dev/null && command -v dpkg-deb >/dev/null || leave_out "there is no apt here"
  list_debian bookworm && ask --download-only -y install oclgrind >/dev/null || leave_out "Oclgrind cannot be fetched here"
  rm -rf "$folder"
  mkdir -p "$folder/vendors"
  for package in "$work"/cache/archives/*.deb; do
    [[ $(basename "$package") =~ $common ]] || dpkg-deb -x "$package" "$folder"
  done
  touch "$folder/complete"
fi
driver=$folder/usr/lib/oclgrind/liboclgrind-rt-icd.so
echo "$driver" >"$folder/vendors/oclgrind.icd"
libraries=("$folder"/usr/lib/*-linux-gnu "$folder"/lib/*-linux-gnu)

# Inlining leaves notes in the text that Oclgrind's interpreter does not know.
export OCLGRIND_BUILD_OPTIONS="-cl-opt-disable -Dalways_inline=" OCLGRIND_DATA_RACES=1 OCLGRIND_LOG=/dev/fd/9
export OCL_ICD_VENDORS=$folder/vendors XDG_CACHE_HOME=$work/cache
paths=$(IFS=: && echo "${libraries[*]}")
if LD_LIBRARY_PATH=$paths ldd "$driver" 2>&1 | grep -q "not found"; then
  leave_out "Oclgrind needs a newer C library than this system has"
fi
failed=0
mkfifo "$work/pipe"

# COMMAND by Oclgrind, whose messages come through a pipe: each of a program's contexts, and of its children's, begins a file anew.
under_oclgrind() {
  local reader status=0
  cat "$work/pipe" >"$work/log" &
  reader=$!
  LD_LIBRARY_PATH=$paths "$@" >"$work/out" 2>&1 9>"$work/pipe" || status=$?
  wait "$reader"
  return "$status"
}

# check WHAT COMMAND...: it succeeds, by Oclgrind, which says nothing.
check() {
  local what=$1 start=$SECONDS
  shift
  if ! under_oclgrind "$@"; then
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
cargo test -q --no-run --test kernels
check "deforming meshes" cargo test -q --test kernels deform::devices_deform_as_the_host_does -- --nocapture
exit "$failed"
