#!/usr/bin/env bash
# What the kernels would take of graphics cards: registers, stacks and spills, told by NVIDIA's and AMD's own compilers,
# without a card. Brings the compilers, none of which is installed: clang, libclc and AMD's device library from Debian 13,
# and ptxas from PyPI.
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/places.sh
fail() { echo "gpu-static: $*" >&2; exit 1; }

scripts/unpack-drivers.sh --tools clang-18 libclc-18 rocm-device-libs-17
tools=$PWD/target/gpu-static
mkdir -p "$tools"
ptxas=$tools/nvidia/cuda_nvcc/bin/ptxas
if [[ ! -e $ptxas ]]; then
  command -v python3 >/dev/null || fail "python3 is missing; install it and its package pip"
  python3 -m pip download -q --no-deps -d "$tools/wheels" nvidia-cuda-nvcc-cu12==12.9.86 ||
    fail "NVIDIA's compiler cannot be fetched from PyPI (nvidia-cuda-nvcc-cu12); see what pip says above"
  python3 -m zipfile -e "$tools"/wheels/*.whl "$tools"
  rm -r "$tools/wheels"
fi
chmod +x "$ptxas"

# A program that its own C library's loader starts, and that finds what belongs to it.
llvm=$tools_folder/usr/lib/llvm-18
{
  echo '#!/bin/sh'
  printf 'exec %q --library-path %q %q -resource-dir %q "$@"\n' "$tools_folder/loader" \
    "$(cat "$tools_folder/paths"):$llvm/lib" "$llvm/bin/clang" "$llvm/lib/clang/18"
} >"$tools/clang"
chmod +x "$tools/clang"

export CLANG=$tools/clang PTXAS=$ptxas
export LIBCLC=$tools_folder/usr/lib/clc/nvptx64--nvidiacl.bc ROCM=$tools_folder/usr/lib/llvm-17/lib/clang/17/amdgcn/bitcode
for part in "$LIBCLC" "$ROCM"; do [[ -e $part ]] || fail "$part is missing; remove $tools_folder and call this again"; done
cargo test --test gpu_static -- --ignored --nocapture "$@"
