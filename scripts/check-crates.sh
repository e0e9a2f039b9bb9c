#!/usr/bin/env bash
# Holds the crates that foveate links to deny.toml, by cargo-deny: licences, sources, duplicates, and known faults
# (advisories). What cannot be checked here is told.
set -euo pipefail
cd "$(dirname "$0")/.."

if ! command -v cargo-deny >/dev/null; then
  echo "check-crates: not run: cargo-deny is missing; cargo install cargo-deny brings it"
  exit 0
fi
cargo deny check licenses bans sources
log=$(mktemp)
trap 'rm -f "$log"' EXIT
if ! cargo deny check advisories 2>"$log"; then
  if grep -q 'failed to fetch advisory database\|failed to load advisory database' "$log"; then
    echo "check-crates: not run: advisories, since their database (https://github.com/RustSec/advisory-db) cannot be had here"
  else
    cat "$log" >&2
    exit 1
  fi
fi
