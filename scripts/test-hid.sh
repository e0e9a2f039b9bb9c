#!/usr/bin/env bash
# Tests the tracker in a real kernel: fetches QEMU and Debian's kernel (which is not installed), and has the
# program read a virtual Rift DK1 in it. Needs Debian; uses sudo where it is not run by root.
set -euo pipefail
cd "$(dirname "$0")/.."

say() { echo "test-hid: $*" >&2; }
for tool in apt-get apt-cache dpkg-deb; do
  command -v "$tool" >/dev/null || { say "this needs Debian's $tool; run it on Debian."; exit 1; }
done
scripts/install-packages.sh hid
# Where the system's QEMU would cost it other packages, one is unpacked.
. scripts/places.sh
export PATH="$tools_folder/bin:$PATH"

package=$(apt-cache depends linux-image-amd64 | sed -n 's/^ *Depends: \(linux-image-[0-9].*\)/\1/p' | awk 'NR == 1')
[[ -n "$package" ]] || { say "no package linux-image-amd64 is known here; run it on Debian (amd64)."; exit 1; }

folder="$PWD/target/hid/$package"
if [[ ! -e "$folder/vmlinuz" ]]; then
  say "fetching $package (not installed)"
  rm -rf "$folder" && mkdir -p "$folder/new"
  (cd "$folder/new" && apt-get download -qq "$package" && dpkg-deb -x ./*.deb .)
  for name in usb-common usbcore hid usbhid hid-generic usbip-core vhci-hcd; do
    module=$(find "$folder/new" -name "$name.ko*" -print -quit)
    case "$module" in
      '') ;; # It is built in.
      *.xz) xz -dc "$module" >"$folder/$name.ko" ;;
      *.zst) zstd -qdc "$module" >"$folder/$name.ko" ;;
      *) cp "$module" "$folder/$name.ko" ;;
    esac
  done
  cp "$folder"/new/boot/vmlinuz-* "$folder/vmlinuz.new"
  rm -rf "$folder/new"
  mv "$folder/vmlinuz.new" "$folder/vmlinuz"
fi

cargo build --bin foveate --example virtual-dk1
FOVEATE_TEST_KERNEL="$folder" cargo test --test hid -- --nocapture
