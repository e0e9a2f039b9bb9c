#!/usr/bin/env bash
# Other OpenCL compilers than PoCL's: Mesa's rusticl, which has no double precision, and Intel's CPU runtime, neither of
# them installed (scripts/opencl-drivers.sh). On each, `foveate devices` has a report, the kernels pass their tests, and a
# frame of each method by each variant of the kernels is held against the same variant's on PoCL: how many bytes of the picture
# differ, and by how much. (Variants walk other trees, so that what is left to chance, as glass is, falls otherwise.) Without
# arguments everything runs; "frames" leaves the kernels' tests out, which take long.
set -euo pipefail
cd "$(dirname "$0")/.."
foveate=$PWD/${FOVEATE:-target/debug/foveate}
drivers=${DRIVERS:-target/opencl-drivers}
what=${1:-all}
scripts/opencl-drivers.sh "$drivers"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failed=0
fail() { echo "test-opencl: $*" >&2; failed=1; }

# Bytes of two 8-bit PNGs that differ, by more than 4, and the greatest difference; fails where more than two in a
# thousand differ by more than 4.
cat >"$work/compare.py" <<'END'
import struct, sys, zlib
def pixels(path):
    data, at, packed = open(path, "rb").read(), 8, b""
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + length]
        if kind == b"IHDR": width, height, depth, colour = struct.unpack(">IIBB", body[:10])
        if kind == b"IDAT": packed += body
        at += 12 + length
    step = {2: 3, 6: 4}[colour]
    assert depth == 8
    rows, raw, above = bytearray(), zlib.decompress(packed), bytearray(width * step)
    for y in range(height):
        start = y * (width * step + 1)
        kind, row = raw[start], bytearray(raw[start + 1:start + 1 + width * step])
        for i in range(len(row)):
            a = row[i - step] if i >= step else 0
            b, c = above[i], above[i - step] if i >= step else 0
            p = a + b - c
            nearest = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            row[i] = (row[i] + [0, a, b, (a + b) // 2, nearest][kind]) & 255
        rows += row
        above = row
    return rows
one, other = map(pixels, sys.argv[1:])
apart = [abs(a - b) for a, b in zip(one, other)]
far = sum(d > 4 for d in apart)
print(f"{sum(d > 0 for d in apart)} of {len(apart)} bytes differ, {far} by more than 4, the most by {max(apart)}")
sys.exit(len(one) != len(other) or far * 500 > len(apart))
END

"$foveate" scene generate demo --out "$work/scene.glb" >/dev/null
render() {
  "$foveate" render "$work/scene.glb" --out "$1" --width 160 --height 100 --samples 2000 --reconstruct "$2" \
    --set trace.traversal="$3" >/dev/null
}
for method in guided k-nn; do
  for variant in packet single-ray; do render "$work/pocl-$method-$variant.png" "$method" "$variant"; done
done

check() {
  local name=$1 folder=$2 platform=$3 method variant apart
  [[ -e "$drivers/$folder/environment" ]] || { echo "not run: $name could not be had here"; return 0; }
  (
    source "$drivers/$folder/environment"
    export XDG_CACHE_HOME=$work/cache-$name
    "$foveate" devices >"$work/devices" || { cat "$work/devices"; exit 1; }
    # Its libraries are for Debian 13's C library, which programs built here may not have.
    grep -q "$platform" "$work/devices" || { echo "not run: $name does not load here"; exit 0; }
    sed -n "2,3s/^/test-opencl: /p" "$work/devices"
    for method in guided k-nn; do
      for variant in packet single-ray; do
        # Intel's vectors of work-items find wrong hits (docs/measurements.md): a start notices, and frames have packets.
        unset CL_CONFIG_CPU_VECTORIZER_MODE
        [[ $variant == packet || $folder != intel ]] || export CL_CONFIG_CPU_VECTORIZER_MODE=1
        render "$work/$name.png" "$method" "$variant" || exit 1
        apart=$(python3 "$work/compare.py" "$work/pocl-$method-$variant.png" "$work/$name.png") || far=1
        echo "test-opencl: $name, $method, $variant: $apart"
        [[ -z "${far:-}" ]] || exit 1
      done
    done
    unset CL_CONFIG_CPU_VECTORIZER_MODE
    [[ "$what" == frames ]] || cargo test --test kernels || exit 1
  ) || fail "$name falls short, see above"
}
check rusticl rusticl 'rusticl'
check intel intel 'Intel'
exit "$failed"
