#!/usr/bin/env bash
# What goes wrong around the program: it is killed at each rename, disks are full or read-only, caches are another
# user's or from the future, it is stopped and goes on, memory is short, eight start at once without a cache, and many
# frames are made. Names of faults as arguments choose; all by default. Some need root, setpriv or strace: not run
# without, and told.
set -euo pipefail
cd "$(dirname "$0")/.."
foveate=$(realpath "${FOVEATE:-target/debug/foveate}")
work=$(mktemp -d)
mounts=()
cleanup() {
  local at
  for at in "${mounts[@]}"; do umount "$at" 2>/dev/null || true; done
  rm -rf "$work"
}
trap cleanup EXIT
passed=0
ok() { echo "test-faults: $*"; passed=$((passed + 1)); }
skip() { echo "not run: $*"; }
fail() {
  echo "test-faults: FAILED: $*" >&2
  tail -n 20 "$work"/*.log >&2 2>/dev/null || true
  exit 1
}

# Caches of this test alone; kernels are built once.
export XDG_CACHE_HOME=$work/cache XDG_STATE_HOME=$work/state
scene=$work/scene.glb
"$foveate" scene generate voxel-town --triangles 60000 --out "$scene" >/dev/null
# One variant of the kernels: which one is faster may differ from one cold start to the next, and so roundings.
small=(--width 96 --height 64 --samples 600 --rays 4 --set trace.traversal=packet)
mock() { "$foveate" mock "$scene" "${small[@]}" --frames 3 "$@"; }
mock --out "$work/truth" >/dev/null 2>"$work/truth.log" || fail "no frames at all"

same() { # a folder of frames
  local picture
  for picture in "$work"/truth/*.png; do
    cmp -s "$picture" "$1/$(basename "$picture")" || fail "$2: $(basename "$picture") differs"
  done
}
no_parts() { # a folder
  local left
  left=$(find "$1" -name '.foveate-*.part' 2>/dev/null | awk 'NR <= 3')
  [[ -z $left ]] || fail "$2: left behind: $left"
}
# Everything that has its name is whole.
whole() {
  local file
  while read -r file; do
    case $file in
      *.png) [[ $(tail -c 8 "$file" | od -An -tx1 | tr -d ' \n') == 49454e44ae426082 ]] || fail "$2: $file is cut off" ;;
      *.gif) [[ $(tail -c 1 "$file" | od -An -tx1 | tr -d ' ') == 3b ]] || fail "$2: $file is cut off" ;;
    esac
  done < <(find "$1" -type f)
}

# Kills it as one of its threads names its first file, then its second, and so on; then it runs again. Kernels' caches are
# their drivers' own, and stay.
fault_renames() {
  command -v strace >/dev/null || { skip "kill at a rename: strace is missing"; return; }
  local at=1 out=$work/renamed cache=$work/cache-renamed
  while :; do
    rm -rf "$out" "$cache"
    cp -r "$work/cache" "$cache"
    # Its own caches are made anew.
    rm -rf "$cache/foveate"
    if XDG_CACHE_HOME=$cache strace -f -qq -o "$work/strace.log" -e trace=rename,renameat,renameat2 \
      -e "inject=rename,renameat,renameat2:signal=KILL:when=$at" \
      "$foveate" mock "$scene" "${small[@]}" --frames 3 --out "$out" >/dev/null 2>"$work/renames.log"; then
      break
    fi
    [[ ! -d $out ]] || whole "$out" "killed at rename $at"
    XDG_CACHE_HOME=$cache mock --out "$out" >/dev/null 2>"$work/again.log" || fail "does not start after a kill at rename $at"
    same "$out" "after a kill at rename $at"
    no_parts "$out" "after a kill at rename $at"
    no_parts "$cache" "after a kill at rename $at"
    at=$((at + 1))
    [[ $at -lt 60 ]] || fail "more than 60 renames"
  done
  [[ $at -gt 2 ]] || fail "only $((at - 1)) renames"
  ok "killed $((at - 1)) times at a rename: nothing half-written has a name, and the next start sweeps"
}

tmpfs() { # folder, size
  mkdir -p "$1"
  mount -t tmpfs -o "size=$2,mode=0700" tmpfs "$1" 2>/dev/null || return 1
  mounts+=("$1")
}

fault_full_disk() {
  tmpfs "$work/full" 64k || { skip "full disk: mounting needs root"; return; }
  if mock --out "$work/full/out" >/dev/null 2>"$work/full.log"; then fail "a full disk is no failure"; fi
  grep -q 'the disk is full' "$work/full.log" || fail "a full disk is not told"
  [[ $(wc -l <"$work/full.log") -le 2 ]] || fail "a full disk is told in many lines"
  no_parts "$work/full" "full disk"
  whole "$work/full" "full disk"
  tmpfs "$work/small-cache" 128k || fail "a second tmpfs"
  XDG_CACHE_HOME=$work/small-cache mock --out "$work/cached" >/dev/null 2>"$work/full.log" || fail "a full disk under the cache"
  same "$work/cached" "full cache"
  no_parts "$work/small-cache" "full cache"
  ok "a full disk is told and leaves nothing half-written; under the cache it is only slow"
}

fault_read_only_cache() {
  tmpfs "$work/locked" 64m || { skip "read-only cache: mounting needs root"; return; }
  mount -o remount,ro "$work/locked" || fail "a read-only tmpfs"
  XDG_CACHE_HOME=$work/locked mock --out "$work/read-only" >/dev/null 2>"$work/read-only.log" || fail "a read-only cache"
  same "$work/read-only" "read-only cache"
  grep -q 'note:' "$work/read-only.log" || fail "a read-only cache is not told"
  ok "a cache on a read-only disk is told, and elsewhere"
}

# Another user's files in the cache, a link, a pipe and a folder that anybody may write to: none is used or changed.
fault_foreign_cache() {
  local cache=$work/foreign file
  rm -rf "$cache"
  cp -r "$work/cache" "$cache"
  file=$(find "$cache/foveate/trees" -name '*.tree' -print -quit)
  [[ -n $file ]] || fail "no tree was kept"
  echo dear >"$work/dear"
  rm "$file" && ln -s "$work/dear" "$file"
  XDG_CACHE_HOME=$cache mock --out "$work/linked" >/dev/null 2>"$work/foreign.log" || fail "a link in the cache"
  [[ $(cat "$work/dear") == dear ]] || fail "a link in the cache was written through"
  rm -f "$file" && mkfifo "$file"
  XDG_CACHE_HOME=$cache timeout 60 "$foveate" mock "$scene" "${small[@]}" --frames 3 --out "$work/piped" >/dev/null 2>"$work/foreign.log" ||
    fail "a pipe in the cache"
  chmod 0777 "$cache/foveate/trees"
  XDG_CACHE_HOME=$cache mock --out "$work/open" >/dev/null 2>"$work/foreign.log" || fail "a cache that anybody may write to"
  same "$work/linked" "link"; same "$work/piped" "pipe"; same "$work/open" "open folder"
  if [[ $EUID -eq 0 ]]; then
    chmod 0700 "$cache/foveate/trees"
    chown -R 65534 "$cache/foveate"
    XDG_CACHE_HOME=$cache mock --out "$work/owned" >/dev/null 2>"$work/foreign.log" || fail "another user's cache"
    same "$work/owned" "another user's cache"
  else
    skip "another user's cache: changing owners needs root"
  fi
  ok "links, pipes and other users' files in the cache are left alone"
}

fault_clocks() {
  find "$work/cache" -type f -exec touch -d 2040-01-01 {} +
  mock --out "$work/future" >/dev/null 2>"$work/clocks.log" || fail "a cache from the future"
  find "$work/cache" -type f -exec touch -d 1970-01-02 {} +
  mock --out "$work/past" >/dev/null 2>"$work/clocks.log" || fail "a cache from the past"
  same "$work/future" "future"; same "$work/past" "past"
  ok "caches from the future and from 1970 do no harm"
}

fault_stop_and_continue() {
  local pid i
  "$foveate" mock "$scene" "${small[@]}" --frames 3 --out "$work/stopped" >/dev/null 2>"$work/stopped.log" &
  pid=$!
  for ((i = 0; i < 6; i++)); do
    sleep 0.3
    kill -STOP "$pid" 2>/dev/null || break
    sleep 1
    kill -CONT "$pid"
  done
  wait "$pid" || fail "stopped and continued, it fails"
  same "$work/stopped" "stopped and continued"
  ok "stopped and continued, $i times: the same pictures"
}

fault_low_memory() {
  local limit
  for limit in 300000 600000 1200000; do
    if (ulimit -v "$limit"; "$foveate" render "$scene" "${small[@]}" --out "$work/low.png") >/dev/null 2>"$work/low.log"; then continue; fi
    [[ -s $work/low.log ]] || fail "with $limit KB it ends without a word"
    grep -qiE 'memory|ulimit' "$work/low.log" || fail "with $limit KB the reason is not told"
  done
  ok "little memory is told as the reason"
}

fault_eight_at_once() {
  local i pids=() cache=$work/cold
  for i in 1 2 3 4 5 6 7 8; do
    XDG_CACHE_HOME=$cache "$foveate" mock "$scene" "${small[@]}" --frames 3 --out "$work/cold-$i" >/dev/null 2>"$work/cold-$i.log" &
    pids+=($!)
  done
  for i in "${!pids[@]}"; do wait "${pids[$i]}" || fail "start $((i + 1)) of eight at once"; done
  for i in 1 2 3 4 5 6 7 8; do same "$work/cold-$i" "start $i of eight"; done
  no_parts "$cache" "eight starts"
  XDG_CACHE_HOME=$cache mock --out "$work/warm" >/dev/null 2>"$work/warm.log" || fail "a start after eight"
  same "$work/warm" "after eight starts"
  ok "eight starts at once without a cache: all the same pictures, one sound cache"
}

resident() { awk '/^VmRSS/ { print int($2 / 1024) }' "/proc/$1/status" 2>/dev/null || echo 0; }
fault_many_frames() {
  local frames=${FRAMES:-12000} pid first=0 last=0 now log=$work/many/frames.jsonl
  "$foveate" mock "$scene" --width 32 --height 20 --samples 60 --rays 1 --frames "$frames" --out "$work/many" \
    >/dev/null 2>"$work/many.log" &
  pid=$!
  while kill -0 "$pid" 2>/dev/null; do
    now=$(resident "$pid")
    [[ $first -gt 0 || ! -e $log || $(wc -l <"$log") -lt $((frames / 10)) ]] || first=$now
    [[ $now -eq 0 ]] || last=$now
    sleep 0.5
  done
  wait "$pid" || fail "many frames"
  [[ $(wc -l <"$log") -eq $frames ]] || fail "$(wc -l <"$log") frames instead of $frames"
  [[ $first -gt 0 && $last -lt $((first + first / 5)) ]] || fail "memory grew from $first MB after a tenth of the frames to $last MB"
  ok "$frames frames: $first MB after a tenth of them, $last MB at the end"
}

all=(renames full_disk read_only_cache foreign_cache clocks stop_and_continue low_memory eight_at_once many_frames)
for fault in "${@:-${all[@]}}"; do "fault_$fault"; done
echo "test-faults: $passed passed"
