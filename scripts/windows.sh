#!/usr/bin/env bash
# Builds foveate.exe (scripts/windows.sh build), or checks that library and program compile for Windows, which needs no
# linker (scripts/windows.sh check). Neither needs a Windows, but that target's std: rustup brings it where its servers
# are to be had; where they are not, a nightly toolchain builds one from the source of std (its component rust-src, or an
# unpacked package of that version), named in RUST_LIBRARY if it is elsewhere.
set -euo pipefail
cd "$(dirname "$0")/.."
task=${1:-check}
target=x86_64-pc-windows-gnu
# What is made for Windows is kept apart, and is not linked with drivers that are unpacked for this system.
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-target/windows} FOVEATE_DRIVERS=

case $task in
  check) cargo=(check --package foveate --lib --bins) ;;
  build)
    cargo=(build --release --bin foveate)
    command -v x86_64-w64-mingw32-gcc >/dev/null || {
      echo "windows: not run: a linker for $target is missing; apt install gcc-mingw-w64-x86-64 brings it" >&2
      exit 1
    } ;;
  *) echo "usage: $0 [check|build]" >&2; exit 2 ;;
esac

std=$(rustc --print target-libdir --target "$target" 2>/dev/null || true)
if compgen -G "$std/libstd-*" >/dev/null; then
  cargo "${cargo[@]}" --target "$target"
elif source=${RUST_LIBRARY:-$(rustc +nightly --print sysroot 2>/dev/null)/lib/rustlib/src/rust/library} && [[ -e $source/std/Cargo.toml ]]; then
  echo "windows: there is no std for $target; building one from $source"
  __CARGO_TESTS_ONLY_SRC_ROOT=$source cargo +nightly "${cargo[@]}" --target "$target" -Zbuild-std=std,panic_unwind
else
  echo "windows: not run: the std for $target is missing; rustup target add $target brings it, or rustup +nightly component add rust-src its source" >&2
  exit 1
fi
if [[ $task == check ]]; then
  echo "windows: foveate compiles for $target"
else
  echo "windows: $CARGO_TARGET_DIR/$target/release/foveate.exe; openxr_loader.dll has to lie beside it for headsets"
fi
