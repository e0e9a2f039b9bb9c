#!/usr/bin/env bash
# Measures what speed costs in accuracy on four scenes: Sponza and Khronos' water bottle, a glossy metal with a
# normal map (both from the test data), the demo scene and a block town of 1,000,000 triangles. Arguments go to foveate measure, such as --quick, or
# --width 640 --height 400. Reports go to out/measure/NAME; a run that was interrupted goes on.
# For presets from these reports: cargo test --lib write_presets -- --ignored
set -euo pipefail
cd "$(dirname "$0")/.."

foveate=${FOVEATE:-target/release/foveate}
data=${FOVEATE_TEST_DATA:-../shared/data}
out=out/measure
mkdir -p "$out"

[[ -e $out/demo.glb ]] || "$foveate" scene generate demo --out "$out/demo.glb"
[[ -e $out/town.glb ]] || "$foveate" scene generate voxel-town --triangles 1000000 --out "$out/town.glb"

"$foveate" measure "$out/demo.glb" --out "$out/demo" "$@"
"$foveate" measure "$out/town.glb" --out "$out/town" "$@"
sponza=$data/scenes/sponza/Sponza.gltf
if [[ -e $sponza ]]; then
  # The sun reaches into the court only from high above.
  "$foveate" measure "$sponza" --out "$out/sponza" "$@" \
    --set environment.sun_elevation=75 --set environment.sun_azimuth=10 --exposure 1
else
  echo "not run: Sponza is not at $sponza"
fi

bottle=$data/scenes/khronos/WaterBottle/WaterBottle.gltf
if [[ -e $bottle ]]; then
  "$foveate" measure "$bottle" --out "$out/bottle" "$@" --set "environment.map=$data/hdri/venice.hdr"
else
  echo "not run: the water bottle is not at $bottle"
fi

echo
cat "$out"/*/comparison.md | awk 'NR <= 2 || !/^\| (scene|---)/'
