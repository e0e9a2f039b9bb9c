#!/usr/bin/env bash
# Tries foveate.exe under Wine: devices, a scene's facts, pictures that must be this system's to the bit, a window, and
# a headset on the tests' OpenXR runtime. Needs what scripts/windows.sh needs, Wine (with its 64-bit part) and Xvfb: Wine
# has Vulkan only where there is a display. Each check prints ok, FAILED or not run. What it makes is left in
# out/test-windows. Wine is not Windows: docs/headsets.md tells what this proves.
set -euo pipefail
cd "$(dirname "$0")/.."
foveate=$PWD/${FOVEATE:-target/debug/foveate}
missing() { echo "test-windows: not run: $*" >&2; exit 1; }

wine=$(command -v wine64 /usr/lib/wine/wine64 wine | head -n 1) || true
[[ -n $wine ]] || missing "Wine is missing; apt install wine64 brings it"
command -v Xvfb >/dev/null && command -v xwd >/dev/null || missing "Xvfb or xwd is missing; apt install xvfb x11-apps brings them"
[[ -x $foveate ]] || missing "$foveate is missing; cargo build makes it, or name another program in FOVEATE"
scripts/windows.sh build
scripts/windows.sh tests
built=${CARGO_TARGET_DIR:-target/windows}/x86_64-pc-windows-gnu/release

out=$PWD/out/test-windows
rm -rf "$out"
mkdir -p "$out"
# Wine's own copy of Windows, which takes 700 MB, and nothing of the user's.
prefix=$(mktemp -d)
display_of=
cleanup() {
  WINEPREFIX=$prefix "$wine" wineboot --kill >/dev/null 2>&1 || true
  if [[ -n $display_of ]]; then kill "$display_of" 2>/dev/null || true; fi
  # Wine's server writes what it knows as it ends.
  for _ in 1 2 3 4 5; do rm -rf "$prefix" 2>/dev/null && break; sleep 1; done
}
trap cleanup EXIT
export WINEPREFIX=$prefix WINEDEBUG=-all WINEDLLOVERRIDES='mscoree=;mshtml='
exec {number}<> <(:)
Xvfb -displayfd "$number" -screen 0 1280x900x24 -nolisten tcp >/dev/null 2>&1 &
display_of=$!
read -r -t 20 display <&"$number" || missing "Xvfb does not start"
export DISPLAY=:$display
"$wine" wineboot --init >/dev/null 2>&1 || missing "Wine cannot make its folders in $prefix; see $wine wineboot"

program=$out/program
mkdir -p "$program"
cp "$built/foveate.exe" "$built/fake_runtime.dll" "$program/"
if [[ ! -e $prefix/drive_c/windows/system32/bcryptprimitives.dll ]]; then
  # Rust's std takes its random numbers from a DLL of Windows that Wine has only since its version 9.
  echo '#include <windows.h>
#include <ntsecapi.h>
BOOL WINAPI ProcessPrng(PBYTE data, SIZE_T length) { return RtlGenRandom(data, (ULONG)length); }' >"$out/random.c"
  x86_64-w64-mingw32-gcc -shared -o "$program/bcryptprimitives.dll" "$out/random.c" -ladvapi32
  echo "test-windows: note: this Wine has no bcryptprimitives.dll; a stand-in is used"
fi

failed=0 passed=0 left_out=0
ok() { echo "test-windows: ok: $*"; passed=$((passed + 1)); }
fail() { echo "test-windows: FAILED: $*"; failed=$((failed + 1)); }
not_run() { echo "test-windows: not run: $*"; left_out=$((left_out + 1)); }

# Runs foveate.exe in $out; what it says goes to $out/NAME.txt and $out/NAME.err.
windows() {
  local name=$1 code
  shift
  code=$({ cd "$out" && timeout 600 "$wine" program/foveate.exe "$@" >"$name.txt" 2>"$name.err"; echo $?; } 2>/dev/null)
  # Wine ends a program's threads by SIGQUIT, and LLVM, which PoCL and lavapipe bring into the same process, has put a
  # handler of its own there: a program that has done its work ends with 131 then. Whether it has is seen in what it left.
  if [[ $code == 131 ]]; then echo "$name" >>"$out/ended-by-wine.txt"; code=0; fi
  return "$code"
}
here() { (cd "$out" && "$foveate" "$@"); }
why() { tail -n 1 "$out/$1.err" 2>/dev/null | tr -d '\r'; }
said() { tr -d '\r' <"$out/$1.txt"; }

here scene generate voxel-town --triangles 20000 --out town.glb >/dev/null

if windows devices devices && said devices | grep -q ': traces' && said devices | grep -q ': reconstructs'; then
  ok "devices: $(said devices | sed -n 's/^\* *//p' | head -n 1)"
else
  fail "devices: no device traces and reconstructs: $(why devices)"
fi

facts() { sed '/buffers/,$d'; }
if windows info scene info town.glb && [[ -n $(said info) && $(said info | facts) == "$(here scene info town.glb | facts)" ]]; then
  ok "scene info: the same as here"
else
  fail "scene info: not the same as here: $(why info)"
fi

flags=(--width 320 --height 200)
here render town.glb "${flags[@]}" --out here.png >/dev/null
if windows render render town.glb "${flags[@]}" --out windows.png && cmp -s "$out/here.png" "$out/windows.png"; then
  ok "render: the same picture as here, to the bit"
else
  fail "render: out/test-windows/windows.png is not here.png: $(why render)"
fi

here mock town.glb "${flags[@]}" --frames 3 --out mock-here >/dev/null
same=0
windows mock mock town.glb "${flags[@]}" --frames 3 --out mock-windows || true
for picture in "$out"/mock-here/frame_*.png; do
  if cmp -s "$picture" "$out/mock-windows/${picture##*/}"; then same=$((same + 1)); fi
done
if [[ $same == 3 ]]; then ok "mock: the same 3 pictures as here, to the bit"; else fail "mock: $same of 3 pictures are the same as here: $(why mock)"; fi

kept=$(find "$prefix/drive_c/users" -ipath '*/AppData/Local/foveate/*' -type f | wc -l)
if [[ $kept -gt 0 ]]; then ok "caches: $kept files below LOCALAPPDATA"; else fail "caches: LOCALAPPDATA has none"; fi

# How many bytes the screen packs to: the more, the more there is to see.
filled() { xwd -silent -root | tee "$out/window.xwd" | gzip -c | wc -c; }
empty=$(filled) full=0
windows window demo town.glb --window --width 960 --height 600 --frames 300 &
shows=$!
for _ in $(seq 600); do
  full=$(filled)
  if [[ $full -gt $((2 * empty + 10000)) ]] || ! kill -0 "$shows" 2>/dev/null; then break; fi
  sleep 0.2
done
if wait "$shows" && [[ $full -gt $((2 * empty + 10000)) ]] && said window | grep -q '^300 frames'; then
  ok "window: 300 frames; the screen (window.xwd) packs to $full bytes, without it to $empty"
else
  fail "window: the screen packs to $full bytes, without it to $empty: $(why window)"
fi

headset() {
  # The loader heeds XR_RUNTIME_JSON for no administrator, which Wine's users are: Windows' way is the registry.
  echo '{"file_format_version":"1.0.0","runtime":{"name":"Scripted test runtime","library_path":".\\fake_runtime.dll"}}' >"$program/runtime.json"
  echo '{}' >"$out/script.json"
  local path code=0 frames wrong
  path=$("$wine" winepath -w "$program/runtime.json" 2>/dev/null | tr -d '\r')
  FAKE_XR_SCRIPT=$("$wine" winepath -w "$out/script.json" 2>/dev/null | tr -d '\r')
  export FAKE_XR_SCRIPT
  "$wine" reg add 'HKLM\Software\Khronos\OpenXR\1' /v ActiveRuntime /d "$path" /f >/dev/null 2>&1
  windows run run town.glb --frames 20 --samples 300 --rays 1 --json || code=$?
  frames=$(grep -c '"call":"xrEndFrame".*"result":"SUCCESS"' "$out/openxr.jsonl" 2>/dev/null) || true
  wrong=$(grep -c '"violation"' "$out/openxr.jsonl" 2>/dev/null) || true
  if [[ $code == 0 && ${frames:-0} -ge 20 && ${wrong:-1} == 0 ]] && said run | grep -q '"frames":20,'; then
    ok "run: 20 frames on the tests' OpenXR runtime, no rule broken"
  else
    fail "run: ended with $code after ${frames:-0} frames, ${wrong:-no log of} rules broken: $(why run)"
  fi
  if grep -q '"call":"xrConvertWin32PerformanceCounterToTimeKHR".*"result":"SUCCESS"' "$out/openxr.jsonl"; then
    ok "clock: the runtime's, by the performance counter"
  else
    fail "clock: the runtime's was not asked for"
  fi
  keys
}

# Escape, typed into a console once some frames are shown, has to end a run that has no other end.
keys() {
  command -v script >/dev/null || { not_run "keys: script is missing; apt install bsdutils brings it"; return 0; }
  rm -f "$out/openxr.jsonl"
  local line="cd '$out' && '$wine' program/foveate.exe run town.glb --samples 300 --rays 1" code=0
  {
    for _ in $(seq 120); do
      if [[ $(grep -c '"xrEndFrame"' "$out/openxr.jsonl" 2>/dev/null) -ge 4 ]]; then break; fi
      sleep 0.5
    done
    sleep 1
    printf '\033'
    # Until the program has ended: a terminal that is closed would end it too.
    for _ in $(seq 60); do if [[ -e $out/keys.done ]]; then break; fi; sleep 0.5; done
  } | { timeout 120 script -qec "$line" /dev/null >"$out/keys.txt" 2>&1 || code=$?; echo "$code" >"$out/keys.done"; }
  code=$(<"$out/keys.done")
  if [[ ($code == 0 || $code == 131) ]] && grep -q 'xrEndSession' "$out/openxr.jsonl" && said keys | grep -q ' frames'; then
    ok "keys: Escape in the console ends the run"
  else
    fail "keys: Escape in the console does not end the run (out/test-windows/keys.txt; code $code)"
  fi
}
if scripts/openxr-loader.sh "$program" 2>"$out/loader.err"; then headset; else not_run "run: $(cat "$out/loader.err")"; fi

if [[ -e $out/ended-by-wine.txt ]]; then
  echo "test-windows: note: Wine ended $(paste -sd ' ' "$out/ended-by-wine.txt") with 131 after their work (docs/headsets.md)"
fi
echo "test-windows: $passed passed, $failed failed, $left_out not run"
[[ $failed == 0 ]]
