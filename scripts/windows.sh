#!/usr/bin/env bash
# Builds foveate.exe (scripts/windows.sh build), the tests' OpenXR runtime as a DLL beside it (scripts/windows.sh tests),
# or checks that library and program compile for Windows, which needs no linker (scripts/windows.sh check). Neither needs
# a Windows, but that target's std: rustup brings it where its servers are to be had; where they are not, a nightly
# toolchain builds one from the source of std (its component rust-src, or an unpacked package of that version), named in
# RUST_LIBRARY if it is elsewhere.
set -euo pipefail
cd "$(dirname "$0")/.."
task=${1:-check}
target=x86_64-pc-windows-gnu
# What is made for Windows is kept apart, and is not linked with drivers that are unpacked for this system.
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-target/windows} FOVEATE_DRIVERS=
missing() { echo "windows: not run: $*" >&2; exit 1; }

case $task in
  check) cargo=(check --package foveate --lib --bins) last=() ;;
  build | tests)
    command -v x86_64-w64-mingw32-g++ >/dev/null ||
      missing "a linker and a C++ compiler for $target are missing; apt install g++-mingw-w64-x86-64 brings them"
    # A folder with nothing but C++'s static library: in its own the linker would find the one that wants a DLL.
    static=$(realpath -m "$CARGO_TARGET_DIR")/static
    mkdir -p "$static"
    cp "$(x86_64-w64-mingw32-g++ -print-file-name=libstdc++.a)" "$static/"
    cargo=(rustc --release --package foveate --bin foveate) last=(-- -L "native=$static")
    if [[ $task == tests ]]; then cargo=(build --release --package fake_runtime --lib) last=(); fi ;;
  *) echo "usage: $0 [check|build|tests]" >&2; exit 2 ;;
esac

std=$(rustc --print target-libdir --target "$target" 2>/dev/null || true)
if compgen -G "$std/libstd-*" >/dev/null; then
  cargo "${cargo[@]}" --target "$target" "${last[@]}"
elif source=${RUST_LIBRARY:-$(rustc +nightly --print sysroot 2>/dev/null)/lib/rustlib/src/rust/library} && [[ -e $source/std/Cargo.toml ]]; then
  echo "windows: there is no std for $target; building one from $source"
  __CARGO_TESTS_ONLY_SRC_ROOT=$source cargo +nightly "${cargo[@]}" --target "$target" -Zbuild-std=std,panic_unwind "${last[@]}"
else
  missing "the std for $target is missing; rustup target add $target brings it, or rustup +nightly component add rust-src its source"
fi
built=$CARGO_TARGET_DIR/$target/release
case $task in
  check) echo "windows: foveate compiles for $target" ;;
  build) echo "windows: $built/foveate.exe; openxr_loader.dll has to lie beside it for headsets (make dist-windows packs both)" ;;
  tests) echo "windows: $built/fake_runtime.dll" ;;
esac
