#!/usr/bin/env bash
# Checks that library and program compile for Windows. No linker and no Windows is needed, but that target's std:
# rustup brings it where its servers are to be had; where they are not, a nightly toolchain builds one from the source
# of std (its component rust-src, or an unpacked package of that version), named in RUST_LIBRARY if it is elsewhere.
set -euo pipefail
cd "$(dirname "$0")/.."
target=x86_64-pc-windows-gnu
# What is checked for Windows is kept apart, and is not linked with drivers that are unpacked for this system.
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-target/windows} FOVEATE_DRIVERS=

std=$(rustc --print target-libdir --target "$target" 2>/dev/null || true)
if compgen -G "$std/libstd-*" >/dev/null; then
  cargo check --target "$target" --lib --bins
elif source=${RUST_LIBRARY:-$(rustc +nightly --print sysroot 2>/dev/null)/lib/rustlib/src/rust/library} && [[ -e $source/std/Cargo.toml ]]; then
  echo "windows-check: there is no std for $target; building one from $source"
  __CARGO_TESTS_ONLY_SRC_ROOT=$source cargo +nightly check --target "$target" --lib --bins -Zbuild-std=std,panic_unwind
else
  echo "windows-check: not run: the std for $target is missing; rustup target add $target brings it, or rustup +nightly component add rust-src its source" >&2
  exit 1
fi
echo "windows-check: foveate compiles for $target"
