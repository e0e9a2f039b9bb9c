#!/usr/bin/env bash
# Runs the fuzz targets, so many seconds each (SECONDS_EACH, by default 60), and keeps what is new of their inputs in
# fuzz/found. Arguments are targets' names; all by default. Needs cargo-fuzz and a nightly compiler. A crash fails,
# with the input's place: put it into fuzz/corpus/TARGET, and `make test` holds it. No sanitizer is built in unless
# SANITIZER names one (address): what the targets reach of this crate has no unsafe code, and builds and runs faster without.
set -euo pipefail
cd "$(dirname "$0")/.."
seconds=${SECONDS_EACH:-60}
sanitizer=${SANITIZER:-none}

command -v cargo-fuzz >/dev/null || {
  echo "fuzz: cargo-fuzz is missing; cargo install cargo-fuzz brings it" >&2; exit 1; }
cargo +nightly --version >/dev/null 2>&1 || {
  echo "fuzz: a nightly compiler is missing; rustup toolchain install nightly brings it" >&2; exit 1; }

if [[ $# -gt 0 ]]; then targets=("$@"); else mapfile -t targets < <(cargo fuzz list); fi
failed=()
for target in "${targets[@]}"; do
  mkdir -p "fuzz/found/$target"
  log=$(mktemp)
  # What is slow is told as well as what crashes: 10 s for one input.
  if cargo +nightly fuzz run --fuzz-dir fuzz -s "$sanitizer" --codegen-units 16 "$target" "fuzz/found/$target" "fuzz/corpus/$target" -- \
    -max_total_time="$seconds" -timeout=10 -rss_limit_mb=4096 -max_len=65536 -print_final_stats=1 >"$log" 2>&1; then
    inputs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    peak=$(sed -n 's/^stat::peak_rss_mb: *//p' "$log")
    echo "fuzz: $target: $inputs inputs in $seconds s, $peak MB at most, no fault"
  else
    failed+=("$target")
    tail -n 40 "$log" >&2
    echo "fuzz: $target: a fault, see above" >&2
  fi
  rm -f "$log"
done
[[ ${#failed[@]} -eq 0 ]] || { echo "fuzz: faults in ${failed[*]}" >&2; exit 1; }
