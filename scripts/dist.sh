#!/usr/bin/env bash
# Builds what others install: out/dist/foveate-VERSION-ARCH-linux.tar.gz, to be unpacked anywhere, and a .deb. Both hold
# the program, its manual and completions, the udev rule of the tracker and the manifest for SteamVR. They need a
# driver for OpenCL and one for Vulkan, which GPUs' drivers bring, and this system's C library or a newer one.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-out/dist}
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | awk 'NR == 1')
machine=$(uname -m)
name=foveate-$version-$machine-linux
say() { echo "dist: $*"; }
fail() { echo "dist: $*" >&2; exit 1; }

# Without drivers that are unpacked for this checkout alone. Variables win over .cargo/config.toml.
export FOVEATE_DRIVERS=
# Rust's library asks for two functions of newer C libraries and does without where they are missing, but the loader
# of an older one refuses their version: so they are missing everywhere.
missing=(-C link-arg=-Wl,--defsym=pidfd_spawnp=0 -C link-arg=-Wl,--defsym=pidfd_getpid=0)
cargo rustc --release --bin foveate -- "${missing[@]}"
cargo build --release --example manual
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
built=${CARGO_TARGET_DIR:-target}/release
"$built/examples/manual" "$work/manual"
binary=$built/foveate

# The C library that it needs at least.
floor=$(objdump -T "$binary" | sed -n 's/.*GLIBC_\([0-9.]*\).*/\1/p' | sort -uV | tail -n 1)
[[ -n $floor ]] || fail "cannot tell which C library $binary needs"
dpkg --compare-versions "$floor" le 2.36 ||
  say "note: it needs a C library of version $floor; Debian 12 has 2.36: build it there for others"

folder=$work/$name
install -D "$binary" "$folder/bin/foveate"
strip --strip-debug "$folder/bin/foveate"
install -D -m 644 -t "$folder" README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE packaging/INSTALL.md
install -D -m 644 -t "$folder/docs" docs/*.md
install -D -m 644 -t "$folder/docs/pictures" docs/pictures/*
install -D -m 644 -t "$folder/configs" configs/default.toml configs/71-oculus-rift-dk1.rules
install -D -m 644 -t "$folder/share/man/man1" "$work"/manual/man/man1/*.1
install -D -m 644 "$work/manual/completions/foveate.bash" "$folder/share/bash-completion/completions/foveate"
install -D -m 644 "$work/manual/completions/_foveate" "$folder/share/zsh/site-functions/_foveate"
install -D -m 644 "$work/manual/completions/foveate.fish" "$folder/share/fish/vendor_completions.d/foveate.fish"
sed 's|"binary_path_linux": *"[^"]*"|"binary_path_linux": "bin/foveate"|' configs/foveate.vrmanifest >"$folder/foveate.vrmanifest"
grep -q '"bin/foveate"' "$folder/foveate.vrmanifest" || fail "configs/foveate.vrmanifest names no program for Linux"

mkdir -p "$out"
date=@$(git log -1 --format=%ct 2>/dev/null || stat -c %Y Cargo.toml)
pack=(--sort=name --owner=0 --group=0 --numeric-owner "--mtime=$date")
tar "${pack[@]}" -C "$work" -cf - "$name" | gzip -9n >"$out/$name.tar.gz"
say "$out/$name.tar.gz, $(du -h "$out/$name.tar.gz" | cut -f 1), for a C library of version $floor or newer"

command -v dpkg-deb >/dev/null || { say "no .deb: dpkg-deb is missing"; exit 0; }
architecture=$(dpkg --print-architecture)
deb=$work/deb
install -D "$folder/bin/foveate" "$deb/usr/bin/foveate"
install -D -m 644 -t "$deb/usr/lib/udev/rules.d" configs/71-oculus-rift-dk1.rules
sed 's|"binary_path_linux": *"[^"]*"|"binary_path_linux": "/usr/bin/foveate"|' configs/foveate.vrmanifest >"$work/vrmanifest"
install -D -m 644 "$work/vrmanifest" "$deb/usr/share/foveate/foveate.vrmanifest"
install -D -m 644 -t "$deb/usr/share/foveate" configs/default.toml
install -D -m 644 -t "$deb/usr/share/doc/foveate" README.md docs/*.md
cat >"$deb/usr/share/doc/foveate/copyright" <<'TEXT'
Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: foveate

Files: *
Copyright: the authors of foveate
License: Expat or Apache-2.0

License: Apache-2.0
 See /usr/share/common-licenses/Apache-2.0.

TEXT
{ echo "License: Expat"; sed 's/^$/./; s/^/ /' LICENSE-MIT; } >>"$deb/usr/share/doc/foveate/copyright"
gzip -9nc CHANGELOG.md >"$deb/usr/share/doc/foveate/changelog.gz"
mkdir -p "$deb/usr/share/man/man1"
for page in "$work"/manual/man/man1/*.1; do gzip -9nc "$page" >"$deb/usr/share/man/man1/${page##*/}.gz"; done
install -D -m 644 "$work/manual/completions/foveate.bash" "$deb/usr/share/bash-completion/completions/foveate"
install -D -m 644 "$work/manual/completions/_foveate" "$deb/usr/share/zsh/vendor-completions/_foveate"
install -D -m 644 "$work/manual/completions/foveate.fish" "$deb/usr/share/fish/vendor_completions.d/foveate.fish"
install -D -m 644 /dev/stdin "$deb/DEBIAN/control" <<TEXT
Package: foveate
Version: $version
Architecture: $architecture
Maintainer: the authors of foveate <noreply@invalid>
Installed-Size: $(du -sk "$deb/usr" | cut -f 1)
Depends: libc6 (>= $floor), libgcc-s1, libstdc++6
Recommends: ocl-icd-libopencl1 | libopencl1, libvulkan1, libopenxr-loader1, libxkbcommon0, libxkbcommon-x11-0
Suggests: pocl-opencl-icd, mesa-vulkan-drivers
Section: graphics
Priority: optional
Description: foveated ray tracing for virtual reality headsets
 Traces glTF and OBJ scenes with OpenCL, finely where the eye looks and sparsely
 elsewhere, and makes both eyes' pictures with Vulkan: for OpenXR headsets, the
 Rift DK1, a window, or files.
TEXT
find "$deb" -exec touch -h -d "$date" {} +
SOURCE_DATE_EPOCH=${date#@} dpkg-deb --root-owner-group -Zxz -b "$deb" "$out/foveate_${version}_$architecture.deb" >/dev/null
say "$out/foveate_${version}_$architecture.deb, $(du -h "$out/foveate_${version}_$architecture.deb" | cut -f 1)"
