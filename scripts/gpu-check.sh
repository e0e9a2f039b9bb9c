#!/usr/bin/env bash
# Tells in one table what foveate does on a machine with a GPU and nothing but its driver.
#
#   scripts/gpu-check.sh pack [FILE.tar.gz]   where foveate is built: makes a bundle of at most 60 MB
#   ./gpu-check.sh [--small]                  in the unpacked bundle, on the machine with the GPU: no Rust and no
#                                             network are needed. --small asks less, for machines without a GPU
#
# A row that cannot be measured says why. It takes at most eight minutes; FOVEATE_CHECK_SECONDS sets another limit.
set -euo pipefail

cd "$(dirname "$0")"
limit=${FOVEATE_CHECK_SECONDS:-470}

pack() {
  cd ..
  local out=${1:-out/gpu-check.tar.gz} profile=${PROFILE:-release} data=${FOVEATE_TEST_DATA:-../shared/data}
  local options=(--profile "$profile") folder=$profile
  [[ $profile == dev ]] && folder=debug
  cargo build "${options[@]}"
  local tests peer
  tests=$(cargo test "${options[@]}" --test kernels --no-run --message-format json \
    | sed -n 's/.*"executable":"\([^"]*kernels-[^"]*\)".*/\1/p' | tail -1)
  peer=$(cargo build "${options[@]}" --bench vulkan_rays --message-format json \
    | sed -n 's/.*"executable":"\([^"]*vulkan_rays-[^"]*\)".*/\1/p' | tail -1)
  bundle=$(mktemp -d)
  trap 'rm -rf "$bundle"' EXIT
  mkdir -p "$bundle/gpu-check/lib" "$bundle/gpu-check/data/scenes" "$(dirname "$out")"
  local to=$bundle/gpu-check
  cp scripts/gpu-check.sh "$to/"
  cp "target/$folder/foveate" "$to/foveate"
  cp "$tests" "$to/kernels-tests"
  cp "$peer" "$to/vulkan-rays"
  strip "$to/foveate" "$to/kernels-tests" "$to/vulkan-rays" 2>/dev/null || true
  if [[ -d $data/scenes/sponza ]]; then
    cp -rL "$data/scenes/sponza" "$to/data/scenes/"
  else
    echo "gpu-check: $data/scenes/sponza is not there; the bundle goes without Sponza" >&2
  fi
  # What machines may lack: loaders, and a C library as new as the one that this was built with.
  local library
  for library in libOpenCL.so.1 libvulkan.so.1 libc.so.6 libm.so.6 libgcc_s.so.1 libudev.so.1 ld-linux-x86-64.so.2; do
    library=$(ldconfig -p | awk -v name="$library" '$1 == name && /x86-64/ { print $NF; exit }')
    [[ -n $library ]] && cp -L "$library" "$to/lib/"
  done
  tar -C "$bundle" -czf "$out" gpu-check
  local bytes
  bytes=$(stat -c %s "$out")
  echo "gpu-check: $out, $((bytes / 1000000)) MB"
  [[ $bytes -le 60000000 ]] || { echo "gpu-check: more than 60 MB" >&2; exit 1; }
}

if [[ ${1:-} == pack ]]; then shift; pack "$@"; exit; fi
small=no
case ${1:-} in
  '') ;;
  --small) small=yes ;;
  *) echo "usage: $0 [pack [FILE.tar.gz] | --small]" >&2; exit 2 ;;
esac
if [[ ! -x foveate ]]; then
  echo "gpu-check: there is no program beside this script; make a bundle with: scripts/gpu-check.sh pack" >&2
  exit 1
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export FOVEATE_TEST_DATA=$PWD/data XDG_CACHE_HOME=$work/cache HOME=${HOME:-$work}

# A loader of our own only where the machine has none.
has_library() { grep -q "$1" <<<"$(ldconfig -p 2>/dev/null)" || ls /usr/lib/*/"$1"* /usr/lib64/"$1"* >/dev/null 2>&1; }
mkdir -p "$work/lib"
for library in libOpenCL.so.1 libvulkan.so.1 libgcc_s.so.1 libudev.so.1; do
  if ! has_library "$library" && [[ -e lib/$library ]]; then cp "lib/$library" "$work/lib/"; fi
done
export LD_LIBRARY_PATH=$work/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
# NVIDIA's driver alone, as in many containers, does not tell loaders where it is.
if [[ -z $(ls /etc/OpenCL/vendors 2>/dev/null) ]] && has_library libnvidia-opencl.so.1; then
  mkdir -p "$work/vendors"
  echo libnvidia-opencl.so.1 >"$work/vendors/nvidia.icd"
  export OCL_ICD_VENDORS=$work/vendors
fi
if [[ -z $(ls /etc/vulkan/icd.d /usr/share/vulkan/icd.d 2>/dev/null) ]] && has_library libGLX_nvidia.so.0; then
  echo '{"file_format_version":"1.0.0","ICD":{"library_path":"libGLX_nvidia.so.0","api_version":"1.3.0"}}' >"$work/nvidia.json"
  export VK_ICD_FILENAMES=$work/nvidia.json VK_DRIVER_FILES=$work/nvidia.json
fi
# An older C library than the program's: the one that travels with it takes over.
loader=()
if ! ./foveate --version >/dev/null 2>&1; then
  loader=("$PWD/lib/ld-linux-x86-64.so.2" --library-path "$PWD/lib:$LD_LIBRARY_PATH:/usr/lib/x86_64-linux-gnu:/usr/lib64")
fi
foveate() { "${loader[@]}" ./foveate "$@"; }

rows=()
row() { rows+=("| $1 | $2 |"); echo "gpu-check: $1: $2" >&2; }
left() { echo $((limit - SECONDS)); }
# Runs a program of the bundle for at most so many seconds, or what is left; its output goes to $work/out.
attempt() {
  local seconds=$1; shift
  if [[ $(left) -lt 5 ]]; then echo "out of time" >"$work/why"; return 1; fi
  [[ $(left) -lt $seconds ]] && seconds=$(left)
  local status=0
  timeout "$seconds" "${loader[@]}" "$@" >"$work/out" 2>"$work/err" || status=$?
  [[ $status -eq 0 ]] && return 0
  if [[ $status -eq 124 ]]; then echo "not done after $seconds s" >"$work/why"; else
    { tail -n 1 "$work/err"; [[ -s $work/err ]] || tail -n 1 "$work/out"; } | cut -c1-200 >"$work/why"
  fi
  return 1
}
not_run() { row "$1" "not run: $(cat "$work/why")"; }
number() { grep -o "\"$1\":[0-9.eE+-]*" "$work/out" | head -1 | cut -d: -f2; }

devices() {
  if ! attempt 60 ./foveate devices; then not_run devices; return; fi
  while read -r line; do [[ -n $line ]] && row device "$line"; done <"$work/out"
  command -v nvidia-smi >/dev/null && row driver "$(nvidia-smi --query-gpu=name,driver_version,memory.total --format=csv,noheader 2>/dev/null | head -1)"
  return 0
}

tests() {
  if attempt 150 ./kernels-tests --test-threads 2 || grep -q '^test result' "$work/out"; then
    row "kernels' tests" "$(grep '^test result' "$work/out" | tail -1 | sed 's/test result: //; s/; 0 measured.*//')"
    { grep '^test .*FAILED' "$work/out" || true; } | while read -r line; do echo "$line"; done >"$work/failed"
    while read -r line; do row "failed" "$line"; done <"$work/failed"
    while read -r line; do row "kernels' tests" "$line"; done < <(grep -o 'not run: .*' "$work/out" | sort -u)
  else
    not_run "kernels' tests"
  fi
}

rates() {
  local name=$1 scene=$2
  if ! attempt 120 ./foveate bench "$scene" --cold "${asked[@]}"; then not_run "$name"; return; fi
  sed -n 1,2p "$work/out" | while read -r line; do echo "$line"; done >"$work/head"
  row "$name" "$(head -1 "$work/head" | sed 's/^[^:]*: //')"
  while IFS= read -r line; do row "$name" "$(echo "$line" | tr -s ' ' | sed 's/^ //')"; done < <(sed -n '3,$p' "$work/out")
}

# The same rays by Vulkan's ray queries and by its ray-tracing pipeline, in turns with ours.
peer() {
  local name="$1, beside Vulkan's own rays"
  if ! attempt 120 ./vulkan-rays --scene "$2" "${rays[@]}"; then not_run "$name"; return; fi
  while IFS= read -r line; do row "$name" "$line"; done <"$work/out"
}

memory() {
  if ! attempt 60 ./foveate scene info "$2" --json; then not_run "$1, memory"; return; fi
  row "$1, memory" "$(($(number device_bytes) / 1048576)) MiB on the device, $(printf %.1f "$(number bytes_per_triangle)") bytes a triangle for nodes, vertices and indices"
}

point() {
  local name=$1; shift
  if ! attempt 90 ./foveate render "$@" --out "$work/picture.exr" --json; then not_run "$name"; return; fi
  local p50 p99
  p50=$(grep -o '"frame_ms":{"p50":[0-9.]*' "$work/out" | grep -o '[0-9.]*$')
  p99=$(grep -o '"p99":[0-9.]*' "$work/out" | head -1 | cut -d: -f2)
  row "$name" "$(printf '%.2f ms a frame (p99 %.2f): trace %.2f, shade %.2f, share %.2f, reconstruct %.2f; %.1f Mrays/s; samples %s' \
    "$p50" "$p99" "$(number trace)" "$(number shade)" "$(number share)" "$(number reconstruct)" \
    "$(number mrays_per_second)" "$(grep -o '"sharing":"[^"]*' "$work/out" | cut -d'"' -f4)")"
}

passes=20 triangles=6700000
paper=(--width 1280 --height 800 --samples 55000)
# The same fraction of the pixels: 2064 * 2208 * 55000 / 1024000 in each eye's view.
modern=(--stereo per-eye --width 4128 --height 2208 --samples 244771)
rays=() asked=(--repetitions 5)
if [[ $small == yes ]]; then
  passes=2 triangles=300000
  modern=(--stereo per-eye --width 1032 --height 552 --samples 15298)
  asked=(--width 640 --height 400 --samples 14000 --repetitions 3)
  rays=(--width 320 --height 200 --samples 4000 --repetitions 3)
fi

devices
if attempt 60 ./foveate devices --json; then
  row sharing "$(sed -n 's/.*"sharing":"\([^"]*\)","sharing_reason":"\([^"]*\)".*/\1: \2/p' "$work/out" | grep . || echo "not run: one of the two devices is missing")"
else
  not_run sharing
fi
sponza=data/scenes/sponza/Sponza.gltf
if [[ -e $sponza ]]; then
  rates Sponza "$sponza"
  peer Sponza "$sponza"
  for method in k-nn guided; do
    point "paper's point, $method" "$sponza" "${paper[@]}" --rays 32 --reconstruct $method --passes $passes
  done
  point "modern point, guided" "$sponza" "${modern[@]}" --rays 32 --reconstruct guided --passes $passes
else
  row Sponza "not run: it is not in the bundle"
fi
if attempt 90 ./foveate scene generate voxel-town --triangles $triangles --out "$work/town.glb"; then
  rates town "$work/town.glb"
  memory town "$work/town.glb"
  peer town "$work/town.glb"
  point "paper's point in the town, guided" "$work/town.glb" "${paper[@]}" --rays 32 --reconstruct guided --passes $passes
else
  not_run town
fi
tests

echo
echo "| what | result |"
echo "| --- | --- |"
printf '%s\n' "${rows[@]}"
echo
missing=$(printf '%s\n' "${rows[@]}" | grep -c 'not run:' || true)
echo "gpu-check: ${#rows[@]} rows, $missing of them not run; took $SECONDS s on $(uname -sr), glibc $(getconf GNU_LIBC_VERSION 2>/dev/null | cut -d' ' -f2)"
