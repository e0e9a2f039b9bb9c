#!/usr/bin/env bash
# Runs all tests, and says at the end how many passed, which failed, and what was not run and why.
# Arguments go to cargo test, such as --test foveation.
set -euo pipefail
cd "$(dirname "$0")/.."

log=$(mktemp)
trap 'rm -f "$log"' EXIT

# Without --show-output cargo keeps the output of passing tests to itself, and with it "not run".
status=0
cargo test --workspace --no-fail-fast "$@" -- --show-output 2>&1 | tee "$log" || status=$?

echo
grep -o 'not run: .*' "$log" | sort | uniq -c | sed 's/^ *\([0-9]*\) /\1 x /' || true
sed -n 's/^test \(.*\) \.\.\. FAILED.*/failed: \1/p' "$log" | while read -r failed name; do
  echo "$failed $name"
  # Why: the first lines of its panic, which may be far above.
  grep -F -A 4 "thread '$name' " "$log" | head -n 5 | cut -c 1-300 | sed 's/^/    /' || true
done
awk -v status="$status" '
  /^test result:/ { passed += $4; failed += $6; ignored += $8; results++ }
  END {
    if (!results) { print "make test: cargo failed before any test ran."; exit }
    printf "make test: %d passed, %d failed, %d ignored%s\n", passed, failed, ignored,
           status && !failed ? "; cargo itself failed, see above" : ""
  }' "$log"
exit "$status"
