#!/usr/bin/env bash
# Packs what others run on Windows: out/dist/foveate-VERSION-x86_64-windows.zip, with foveate.exe, OpenXR's loader where
# it can be had (scripts/openxr-loader.sh), the manifest for SteamVR, and licences.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-out/dist}
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | awk 'NR == 1')
name=foveate-$version-x86_64-windows
say() { echo "dist-windows: $*"; }
fail() { echo "dist-windows: $*" >&2; exit 1; }
command -v python3 >/dev/null || fail "python3, which packs the zip, is missing; apt install python3 brings it"

scripts/windows.sh build
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
folder=$work/$name
install -D "${CARGO_TARGET_DIR:-target/windows}/x86_64-pc-windows-gnu/release/foveate.exe" "$folder/foveate.exe"
x86_64-w64-mingw32-strip --strip-debug "$folder/foveate.exe"
foreign=$(x86_64-w64-mingw32-objdump -p "$folder/foveate.exe" | sed -n 's/.*DLL Name: \(lib.*\)/\1/p')
[[ -z $foreign ]] || fail "foveate.exe needs $foreign, which Windows does not have"
install -m 644 -t "$folder" README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE packaging/WINDOWS.md
install -D -m 644 -t "$folder/docs" docs/*.md
install -D -m 644 -t "$folder/docs/pictures" docs/pictures/*
install -D -m 644 -t "$folder/configs" configs/default.toml
sed 's|"binary_path_windows": *"[^"]*"|"binary_path_windows": "foveate.exe"|' configs/foveate.vrmanifest >"$folder/foveate.vrmanifest"
grep -q '"foveate.exe"' "$folder/foveate.vrmanifest" || fail "configs/foveate.vrmanifest names no program for Windows"
scripts/openxr-loader.sh "$folder" || say "note: without OpenXR's loader; WINDOWS.md in the zip tells where to get it"

date=@$(git log -1 --format=%ct 2>/dev/null || stat -c %Y Cargo.toml)
find "$folder" -exec touch -h -d "$date" {} +
mkdir -p "$out"
rm -f "$out/$name.zip"
(cd "$work" && python3 -m zipfile --create "$name.zip" "$name")
mv "$work/$name.zip" "$out/"
say "$out/$name.zip, $(du -h "$out/$name.zip" | cut -f 1)"
