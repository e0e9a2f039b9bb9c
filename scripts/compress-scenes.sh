#!/usr/bin/env bash
# Compresses a scene by gltf-transform in each way that the loader reads: scripts/compress-scenes.sh scene.glb FOLDER
# Without arguments it makes the files of tests/files/scenes anew, from a generated town. Needs node and npm.
set -euo pipefail
cd "$(dirname "$0")/.."
command -v npm >/dev/null || { echo "compress-scenes: npm is missing; install Node.js 20 or later." >&2; exit 1; }
packages=target/compress-scenes
mkdir -p "$packages"
npm install --silent --no-audit --no-fund --prefix "$packages" \
  @gltf-transform/core@4.5.1 @gltf-transform/extensions@4.5.1 @gltf-transform/functions@4.5.1 \
  draco3dgltf@1.5.7 meshoptimizer@1.2.0 ktx2-encoder@0.6.0 pngjs@7.0.0
cp scripts/{compress-scenes,compress-textures,read-scene}.mjs "$packages/"
if [[ $# -eq 0 ]]; then
  cargo run --quiet -- scene generate voxel-town --triangles 10000 --out "$packages/town.glb"
  set -- "$packages/town.glb" tests/files/scenes
fi
mkdir -p "$2"
for script in compress-scenes compress-textures; do
  node "$packages/$script.mjs" "$(realpath "$1")" "$(realpath "$2")"
done
ls -l "$2"
