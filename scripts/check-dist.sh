#!/usr/bin/env bash
# Runs what `make dist` has built in another system's root: scripts/check-dist.sh ROOT [PACKAGE...], as root. ROOT is a
# bare system, such as debootstrap makes. The program has to start there, write a scene, and say in a sentence that
# drivers are missing. With packages, which are installed there by apt (pocl-opencl-icd mesa-vulkan-drivers), the .deb is
# installed too, has to bring program, manual, completions and rule, and a picture is rendered.
set -euo pipefail
cd "$(dirname "$0")/.."
root=${1:?a root to run it in}
shift
fail() { echo "check-dist: $root: $*" >&2; exit 1; }
archive=$(ls out/dist/foveate-*-linux.tar.gz 2>/dev/null | tail -n 1)
package=$(ls out/dist/foveate_*.deb 2>/dev/null | tail -n 1)
[[ -n $archive ]] || fail "there is nothing to check; run make dist"
mounts=()
cleanup() { local at; for at in "${mounts[@]}"; do umount "$at" 2>/dev/null || true; done; }
trap cleanup EXIT
bind() {
  mkdir -p "$root/$1"
  if ! mountpoint -q "$root/$1"; then mount --bind "/$1" "$root/$1"; mounts=("$root/$1" "${mounts[@]}"); fi
}
bind proc; bind dev; bind sys
inside() { chroot "$root" env -i HOME=/tmp/home PATH=/usr/bin:/bin:/usr/sbin:/sbin LC_ALL=C "$@"; }

name=$(. "$root/etc/os-release" && echo "$PRETTY_NAME")
rm -rf "$root/opt/check" "$root/tmp/home"
mkdir -p "$root/opt/check" "$root/tmp/home"
tar -xf "$archive" -C "$root/opt/check" --strip-components=1
program=/opt/check/bin/foveate
inside $program --version >/dev/null || fail "the program does not start"
inside $program scene generate demo --out /tmp/home/demo.glb >/dev/null || fail "no scene is written"
if [[ $# -eq 0 ]]; then
  said=$(inside $program render /tmp/home/demo.glb --out /tmp/home/picture.png 2>&1) && fail "a picture without drivers"
  [[ $(wc -l <<<"$said") -eq 1 && $said == "foveate: no usable "* ]] || fail "without drivers it says: $said"
  echo "check-dist: $name: $(inside $program --version), starts, and says what is missing"
  exit 0
fi
cp /etc/resolv.conf "$root/etc/resolv.conf"
cp "$package" "$root/opt/check.deb"
inside apt-get update -qq
inside env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends ocl-icd-libopencl1 libvulkan1 "$@" >/dev/null ||
  fail "$* cannot be installed"
inside env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends /opt/check.deb >/dev/null || fail "the .deb cannot be installed"
for file in usr/bin/foveate usr/share/man/man1/foveate-render.1.gz usr/share/bash-completion/completions/foveate \
  usr/lib/udev/rules.d/71-oculus-rift-dk1.rules usr/share/foveate/foveate.vrmanifest; do
  [[ -e $root/$file || $file == usr/share/man/* ]] || fail "the .deb brings no $file"
done
inside foveate devices >/dev/null || fail "no device can be used: $(inside foveate devices 2>&1 | tail -n 3)"
inside foveate render /tmp/home/demo.glb --width 160 --height 100 --out /tmp/home/picture.png >/dev/null || fail "no picture"
[[ $(stat -c %s "$root/tmp/home/picture.png") -gt 10000 ]] || fail "an empty picture"
inside dpkg --remove foveate >/dev/null
echo "check-dist: $name: $(inside $program --version), the .deb renders a picture with $*"
