#!/usr/bin/env bash
# A client and two servers on this machine, whose devices share frames. In one run a server is held up for a
# while, and takes part again afterwards; in another it is killed. Frames go on, and all pictures are those
# that this machine makes alone. Then there is one server only: while it is held up the client says so, and goes on
# when it is back; where it stays away, from the start or from the middle on, the client says so and ends by itself.
set -euo pipefail
cd "$(dirname "$0")/.."
remote=${POCL_REMOTE:-target/pocl-remote}
foveate=${FOVEATE:-target/debug/foveate}
frames=24
# Which kernels are faster may differ from one start to the next, and so roundings; and a cache of light that has missed
# views differs from one that has not, within its noise.
settings=(--width 192 --height 120 --samples 2000 --set trace.traversal=packet --set trace.indirect=paths)

if [[ ! -x "$remote/pocld" ]]; then
  scripts/build-pocl-remote.sh "$remote"
fi
remote=$(cd "$remote" && pwd)
work=$(mktemp -d)
servers=()
# Only what was started here is ended.
cleanup() { for pid in "${servers[@]}"; do kill -9 "$pid" 2>/dev/null || true; done; rm -rf "$work"; }
trap cleanup EXIT
fail() { echo "test-remote: $*" >&2; cat "$work"/*.log >&2; exit 1; }

# Platforms without devices, as Mesa's often is, confuse the server: it is shown PoCL alone.
mkdir "$work/vendors"
cp "${OCL_ICD_VENDORS:-/etc/OpenCL/vendors}"/pocl*.icd "$work/vendors/" \
  || fail "PoCL is not among the OpenCL drivers here (pocl-opencl-icd)"
serve() {
  OCL_ICD_VENDORS=$work/vendors POCLD_LOGLEVEL=err "$remote/pocld" -a 127.0.0.1 -p "$1" >"$work/server-$1.log" 2>&1 &
  servers+=($!)
  disown
}
serve 12010
serve 12020
sleep 2

render() {
  "$foveate" mock "$work/scene.glb" "${settings[@]}" --frames "$frames" --devices "$1" \
    --out "$work/$2" --json
}
"$foveate" scene generate voxel-town --triangles 20000 --out "$work/scene.glb" >/dev/null
render 0 alone >"$work/alone.json" 2>"$work/alone.log"

log=$work/frames.jsonl
lines() { { wc -l <"$log"; } 2>/dev/null || echo 0; }

# Renders on both servers in the background, and waits until they have shared six frames.
start() {
  rm -rf "$work/remote"
  log=$work/remote/frames.jsonl
  (
    export OCL_ICD_VENDORS=$remote/vendors POCL_DEVICES="remote remote"
    export POCL_REMOTE0_PARAMETERS=127.0.0.1:12010/0 POCL_REMOTE1_PARAMETERS=127.0.0.1:12020/0
    exec timeout 900 "$foveate" mock "$work/scene.glb" "${settings[@]}" \
      --frames "$frames" --devices 0,1 --out "$work/remote" --json >"$work/remote.json" 2>"$work/remote.log"
  ) &
  client=$!
  wait_for_frames 6
  grep -q "$idle" <<<"$(head -n 6 "$log")" && fail "a device had nothing to do although both servers answered"
  return 0
}

wait_for_frames() {
  until [[ $(lines) -ge $1 ]]; do
    kill -0 "$client" 2>/dev/null || fail "the client ended after $(lines) frames instead of $frames"
    sleep 0.05
  done
}

# Waits for the client, and compares all its pictures.
finish() {
  wait "$client" || fail "the client failed"
  [[ $(lines) -eq $frames ]] || fail "$(lines) frames instead of $frames"
  local picture
  compared=0
  for picture in "$work"/alone/*.png; do
    cmp -s "$picture" "$work/remote/$(basename "$picture")" || fail "$(basename "$picture") is not what one machine makes alone"
    compared=$((compared + 1))
  done
  [[ $compared -gt 2 ]] || fail "there were no pictures to compare"
}

# Renders on the first server alone, in the background, with so many frames.
start_alone() {
  rm -rf "$work/remote"
  log=$work/remote/frames.jsonl
  (
    export OCL_ICD_VENDORS=$remote/vendors POCL_DEVICES=remote POCL_REMOTE0_PARAMETERS=127.0.0.1:12010/0
    exec timeout 900 "$foveate" mock "$work/scene.glb" "${settings[@]}" \
      --frames "$frames" --devices 0 --out "$work/remote" --json >"$work/remote.json" 2>"$work/remote.log"
  ) &
  client=$!
}

# Waits so many seconds for a word of the client.
told() {
  local seconds=$1 words=$2
  for ((i = 0; i < seconds * 10; i++)); do
    grep -qE "$words" "$work/remote.log" && return 0
    sleep 0.1
  done
  fail "the client has not said \"$words\" within $seconds s"
}

# Waits so many seconds for the client's end, which is a failure with a sentence.
ends_within() {
  local i
  for ((i = 0; i < $1 * 10; i++)); do
    kill -0 "$client" 2>/dev/null || break
    sleep 0.1
  done
  kill -0 "$client" 2>/dev/null && fail "the client has not ended within $1 s"
  ! wait "$client" || fail "the client ended well without a device"
  grep -q '"code":"no-device"' "$work/remote.log" || fail "the client does not say why it ended"
}

idle='"samples":0,"trace_ms":0'
start
kill -STOP "${servers[1]}"
wait_for_frames $((frames - 12))
kill -CONT "${servers[1]}"
finish
grep -q "$idle" <<<"$(sed -n "7,$((frames - 12))p" "$log")" || fail "both devices had work while one server was held up"
grep -vq "$idle" <<<"$(tail -n 3 "$log")" || fail "a server that answered again got no work"
echo "test-remote: $frames frames, a server held up after frame 6 and back again, $compared pictures as one machine makes them alone."

start
kill -9 "${servers[1]}"
at=$(lines)
[[ $at -lt $frames ]] || fail "the server was killed too late"
finish
grep -q "$idle" <<<"$(tail -n 1 "$log")" || fail "both devices had work after one server was killed"
echo "test-remote: $frames frames, a server killed after frame $at, $compared pictures as one machine makes them alone."

start_alone
wait_for_frames 6
kill -STOP "${servers[0]}"
told 20 'no device is left to trace with'
kill -CONT "${servers[0]}"
finish
echo "test-remote: $frames frames on one server, which was held up after frame 6, $compared pictures as one machine makes them alone."

start_alone
wait_for_frames 6
kill -STOP "${servers[0]}"
told 20 'no device is left to trace with'
kill -INT "$client"
for ((i = 0; i < 50; i++)); do kill -0 "$client" 2>/dev/null || break; sleep 0.1; done
kill -0 "$client" 2>/dev/null && fail "Ctrl-C does not end a client whose server is held up"
wait "$client" && fail "the client ended well on Ctrl-C"
echo "test-remote: Ctrl-C ends a client whose only server is held up."

start_alone
told 20 'has not answered'
ends_within 90
echo "test-remote: a client whose only server is held up from the start says so, and ends."
kill -CONT "${servers[0]}"

start_alone
wait_for_frames 6
kill -9 "${servers[0]}"
told 30 'no device is left to trace with'
ends_within 120
echo "test-remote: a client whose only server was killed in the middle says so, and ends."
