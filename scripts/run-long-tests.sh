#!/usr/bin/env bash
# Runs the tests that `make test` leaves out because they take long: those that are ignored and whose names begin
# with long_. Arguments go to cargo test, such as --test kernels. That none was run is a failure.
set -euo pipefail
cd "$(dirname "$0")/.."

log=$(mktemp)
trap 'rm -f "$log"' EXIT

status=0
cargo test --workspace --no-fail-fast "$@" -- --ignored --nocapture --test-threads=1 long_ 2>&1 | tee "$log" || status=$?

awk -v status="$status" '
  /^test result:/ { passed += $4; failed += $6 }
  END {
    printf "make test-long: %d passed, %d failed\n", passed, failed
    if (!status && !passed) { print "make test-long: no test was run."; status = 1 }
    exit status
  }' "$log"
