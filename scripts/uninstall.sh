#!/usr/bin/env bash
# Undoes scripts/install-packages.sh, scripts/unpack-drivers.sh and `make install-udev`: removes unpacked drivers, the
# packages that were installed for foveate and that nothing else needs, the udev rule, and what earlier versions of
# these scripts left. What was built stays; it needs `cargo build` again where it was built for unpacked drivers.
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/places.sh

say() { echo "uninstall: $*"; }
as_root() {
  if [[ $EUID -eq 0 ]]; then "$@"; return; fi
  command -v sudo >/dev/null || { echo "uninstall: run this as root (there is no sudo): $*" >&2; exit 1; }
  sudo "$@"
}

remove() {
  local file
  for file in "$@"; do
    [[ -e $file ]] || continue
    if [[ -w $(dirname "$file") ]]; then rm -rf "$file"; else as_root rm -rf "$file"; fi
    say "removed $file"
  done
}

# What would go along with packages, beside themselves.
along() { apt-get -s -qq remove "$@" | awk '/^Remv/ { print $2 }' | sort | comm -13 <(printf '%s\n' "${ours[@]}") -; }

packages() {
  [[ -e $installed_list ]] || return 0
  local ours=() gone=() kept=() package
  for package in $(sort -u "$installed_list"); do
    if dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null | grep -qx installed; then ours+=("$package"); fi
  done
  if [[ ${#ours[@]} -gt 0 && -z $(along "${ours[@]}") ]]; then
    gone=("${ours[@]}")
  else
    for package in "${ours[@]}"; do
      if [[ -z $(along "$package") ]]; then gone+=("$package"); else kept+=("$package"); fi
    done
  fi
  if [[ ${#gone[@]} -gt 0 ]]; then
    as_root env DEBIAN_FRONTEND=noninteractive apt-get remove --purge -y -qq "${gone[@]}" >/dev/null
    say "removed ${#gone[@]} packages"
  fi
  [[ ${#kept[@]} -eq 0 ]] || say "kept what other packages need by now: ${kept[*]}"
  rm -f "$installed_list"
}

packages
if [[ -e $cargo_config ]] && grep -q 'scripts/unpack-drivers.sh' "$cargo_config"; then remove "$cargo_config"; fi
remove "$drivers_folder" "$tools_folder" "$udev_rule"
if [[ -e $old_list ]]; then
  say "an earlier version installed packages of Debian 13, which stay: apt cannot go back to older ones by itself"
fi
if [[ -e $old_monado ]]; then remove "${old_files[@]}"; fi
remove "$old_list" "$old_pin" "$old_monado"
rmdir "$foveate_data" 2>/dev/null || true
