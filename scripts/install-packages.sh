#!/usr/bin/env bash
# Installs the system packages that foveate needs on Debian and Ubuntu:
#   scripts/install-packages.sh demo    OpenCL and Vulkan on the CPU (PoCL, lavapipe), and keyboards of windows
#   scripts/install-packages.sh test    the same, and what the tests start
#   scripts/install-packages.sh bench   the same as demo, and what benchmarks compare with (Embree 4, a C++ compiler)
#   scripts/install-packages.sh remote  the same as demo, and what PoCL's network driver is built with
#   scripts/install-packages.sh hid     the virtual machine of scripts/test-hid.sh
# Does nothing when all of them are there; uses sudo where it is not run by root.
set -euo pipefail

demo=(pocl-opencl-icd ocl-icd-libopencl1 mesa-vulkan-drivers libvulkan1 libxkbcommon0 libxkbcommon-x11-0)
test=("${demo[@]}" vulkan-validationlayers libopenxr-loader1 openxr-layer-corevalidation xvfb x11-apps)
hid=(qemu-system-x86 binutils xz-utils)
# The report page is tested in a browser; Ubuntu offers this one as a snap only, which wants more than apt.
{ . /etc/os-release; } 2>/dev/null || true
[[ "${ID:-}" == ubuntu ]] || test+=(chromium)
bench=("${demo[@]}" libembree-dev g++)
remote=("${demo[@]}" cmake git g++ make patch pkg-config ocl-icd-dev ocl-icd-opencl-dev clinfo)
# An OpenXR runtime with a simulated headset: its service, and what it loads into programs.
monado=(monado-service libopenxr1-monado)
# Where it goes on Debian 12, which has none.
monado_folder=/usr/local/lib/foveate-monado
# What the program, its tests and its benchmarks need newer than Debian 12 has it, and from which version on.
declare -A floors=([pocl-opencl-icd]=6 [mesa-vulkan-drivers]=25 [libopenxr-loader1]=1.1 [openxr-layer-corevalidation]=1.1 [libembree-dev]=4)

case "${1:-demo}" in
  demo) wanted=("${demo[@]}"); monado=() ;;
  test) wanted=("${test[@]}") ;;
  bench) wanted=("${bench[@]}"); monado=() ;;
  remote) wanted=("${remote[@]}"); monado=() ;;
  hid) wanted=("${hid[@]}"); monado=() ;;
  *) echo "usage: $0 [demo|test|bench|remote|hid]" >&2; exit 2 ;;
esac

if ! command -v apt-get >/dev/null; then
  echo "install-packages: this is not Debian or Ubuntu; install an OpenCL and a Vulkan driver yourself (for the CPU: PoCL and Mesa's lavapipe)." >&2
  exit 0
fi

trixie_list=/etc/apt/sources.list.d/foveate-trixie.list
# Once it has a few packages of Debian 13, Debian 12 calls itself so.
old_debian=no
if [[ "${ID:-}" == debian && "${VERSION_ID:-99}" -lt 13 || -e "$trixie_list" ]]; then
  old_debian=yes
  # What Monado's part in programs links, which the system must have.
  [[ ${#monado[@]} -eq 0 ]] || wanted+=(libcjson1)
else
  wanted+=("${monado[@]}")
fi

version() { { dpkg-query -W -f '${db:Status-Status} ${Version}' "$1" 2>/dev/null || true; } | sed -n 's/^installed //p'; }

missing=() newer=()
for package in "${wanted[@]}"; do
  have=$(version "$package")
  if [[ $old_debian == yes && -n "${floors[$package]:-}" ]]; then
    if [[ -z "$have" ]] || dpkg --compare-versions "${have#*:}" lt "${floors[$package]}"; then newer+=("$package"); fi
  elif [[ -z "$have" ]]; then
    missing+=("$package")
  fi
done
unpack=no
[[ $old_debian == yes && ${#monado[@]} -gt 0 && ! -e "$monado_folder/complete" ]] && unpack=yes

[[ ${#missing[@]} -eq 0 && ${#newer[@]} -eq 0 && $unpack == no ]] && exit 0

as_root() {
  if [[ $EUID -eq 0 ]]; then "$@"; return; fi
  if ! command -v sudo >/dev/null; then
    echo "install-packages: run this as root (there is no sudo): $*" >&2; exit 1
  fi
  sudo "$@"
}

# Adds Debian 13 at a priority at which nothing is upgraded by itself.
add_trixie() {
  [[ -e "$trixie_list" ]] && return
  # The mirror that this machine already uses for its own release serves the newer one too.
  mirror=$(apt-get indextargets --format '$(REPO_URI) $(RELEASE) $(COMPONENT)' \
    | awk -v release="${VERSION_CODENAME}" '$2 == release && $3 == "main" { print $1; exit }')
  if [[ -z "$mirror" ]]; then
    echo "install-packages: no Debian mirror is configured on this machine; add one to /etc/apt/sources.list" >&2; exit 1
  fi
  echo "install-packages: Debian ${VERSION_ID} is older than these drivers need; adding Debian 13 (trixie) at pin priority 100,"
  echo "install-packages: so that nothing else is upgraded ($trixie_list)."
  echo "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] $mirror trixie main" \
    | as_root tee "$trixie_list" >/dev/null
  printf 'Package: *\nPin: release n=trixie\nPin-Priority: 100\n' \
    | as_root tee /etc/apt/preferences.d/foveate-trixie >/dev/null
}

# Unpacks Monado with all libraries that it needs into a folder of its own: installed, they would
# replace half of Debian 12. What the system has in the same version is left out.
unpack_monado() {
  local work uri file package file_version
  work=$(mktemp -d)
  : > "$work/status"
  apt-get install --print-uris -qq -y -t trixie --no-install-recommends \
    -o Dir::State::status="$work/status" "${monado[@]}" | tr -d "'" > "$work/packages"
  mkdir "$work/debs"
  while read -r uri file _; do
    package=${file%%_*}
    file_version=$(cut -d_ -f2 <<<"$file" | sed 's/%3a/:/')
    [[ "$(version "$package")" == "$file_version" ]] || echo "$package=$file_version"
  done < "$work/packages" > "$work/names"
  (cd "$work/debs" && xargs apt-get download -qq -t trixie < "$work/names")
  as_root rm -rf "$monado_folder"
  as_root mkdir -p "$monado_folder"
  for file in "$work"/debs/*.deb; do as_root dpkg-deb -x "$file" "$monado_folder"; done
  local libraries="$monado_folder/usr/lib/x86_64-linux-gnu"
  libraries+=":$monado_folder/usr/lib:$libraries/blas:$libraries/lapack:$libraries/pulseaudio"
  printf '#!/bin/sh\nLD_LIBRARY_PATH=%s exec %s/usr/bin/monado-service "$@"\n' "$libraries" "$monado_folder" \
    | as_root tee /usr/local/bin/monado-service >/dev/null
  as_root chmod +x /usr/local/bin/monado-service
  as_root mkdir -p /usr/share/openxr/1
  sed "s|libopenxr_monado.so|$monado_folder/usr/lib/x86_64-linux-gnu/&|" \
    "$monado_folder/usr/share/openxr/1/openxr_monado.json" | as_root tee /usr/share/openxr/1/openxr_monado.json >/dev/null
  as_root touch "$monado_folder/complete"
  rm -rf "$work"
}

export DEBIAN_FRONTEND=noninteractive
echo "install-packages: installing ${newer[*]} ${missing[*]} ${monado[*]}"
[[ $old_debian == yes ]] && add_trixie
as_root apt-get update -qq
if [[ ${#missing[@]} -gt 0 ]]; then
  as_root apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
fi
if [[ ${#newer[@]} -gt 0 ]]; then
  as_root apt-get install -y -qq --no-install-recommends -t trixie "${newer[@]}" >/dev/null
fi
[[ $unpack == no ]] || unpack_monado
