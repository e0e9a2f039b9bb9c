#!/usr/bin/env bash
# Installs the system packages that foveate needs on Debian and Ubuntu:
#   scripts/install-packages.sh demo    OpenCL and Vulkan on the CPU (PoCL, lavapipe), and keyboards of windows
#   scripts/install-packages.sh test    the same, and what the tests start
#   scripts/install-packages.sh bench   the same as demo, and what benchmarks compare with (Embree 4, a C++ compiler)
#   scripts/install-packages.sh remote  the same as demo, and what PoCL's network driver is built with
# Does nothing when all of them are there; uses sudo where it is not run by root.
set -euo pipefail

demo=(pocl-opencl-icd ocl-icd-libopencl1 mesa-vulkan-drivers libvulkan1 libxkbcommon0 libxkbcommon-x11-0)
test=("${demo[@]}" vulkan-validationlayers xvfb)
# The report page is tested in a browser; Ubuntu offers this one as a snap only, which wants more than apt.
{ . /etc/os-release; } 2>/dev/null || true
[[ "${ID:-}" == ubuntu ]] || test+=(chromium)
bench=("${demo[@]}" libembree-dev g++)
remote=("${demo[@]}" cmake git g++ make pkg-config ocl-icd-dev ocl-icd-opencl-dev clinfo)

case "${1:-demo}" in
  demo) wanted=("${demo[@]}") ;;
  test) wanted=("${test[@]}") ;;
  bench) wanted=("${bench[@]}") ;;
  remote) wanted=("${remote[@]}") ;;
  *) echo "usage: $0 [demo|test|bench|remote]" >&2; exit 2 ;;
esac

installed() { dpkg-query -W -f '${db:Status-Status}' "$1" 2>/dev/null | grep -qx installed; }
major() { { dpkg-query -W -f '${Version}' "$1" 2>/dev/null || true; } | sed 's/^[0-9]*://; s/\..*//'; }

if ! command -v apt-get >/dev/null; then
  echo "install-packages: this is not Debian or Ubuntu; install an OpenCL and a Vulkan driver yourself (for the CPU: PoCL and Mesa's lavapipe)." >&2
  exit 0
fi

missing=()
for package in "${wanted[@]}"; do installed "$package" || missing+=("$package"); done

# Debian 12 has PoCL 3.1, Mesa 22.3 and Embree 3; the program is tried on 6.0 and 25.0 and later, its
# benchmarks ask for Embree 4.
old_debian=no
. /etc/os-release
# A package from there may have brought Debian 13's name along: the pin that was written then tells.
pin=/etc/apt/preferences.d/foveate-trixie
if [[ "${ID:-}" == debian && ( "${VERSION_ID:-99}" -lt 13 || -e $pin ) ]]; then
  old_debian=yes
  for package in "${wanted[@]}"; do
    case $package in
      pocl-opencl-icd) floor=6 ;;
      mesa-vulkan-drivers) floor=25 ;;
      libembree-dev) floor=4 ;;
      *) continue ;;
    esac
    version=$(major "$package")
    if [[ -n "$version" && "$version" -lt "$floor" ]]; then missing+=("$package"); fi
  done
fi

[[ ${#missing[@]} -eq 0 ]] && exit 0

as_root() {
  if [[ $EUID -eq 0 ]]; then "$@"; return; fi
  if ! command -v sudo >/dev/null; then
    echo "install-packages: run this as root (there is no sudo): $*" >&2; exit 1
  fi
  sudo "$@"
}

export DEBIAN_FRONTEND=noninteractive
echo "install-packages: installing ${missing[*]}"
suite=()
if [[ $old_debian == yes && ! -e $pin ]]; then
  # The mirror that this machine already uses for its own release serves the newer one too.
  mirror=$(apt-get indextargets --format '$(REPO_URI) $(RELEASE) $(COMPONENT)' \
    | awk -v release="${VERSION_CODENAME}" '$2 == release && $3 == "main" { print $1; exit }')
  if [[ -z "$mirror" ]]; then
    echo "install-packages: no Debian mirror is configured on this machine; add one to /etc/apt/sources.list" >&2; exit 1
  fi
  echo "install-packages: Debian ${VERSION_ID} is older than these drivers need; adding Debian 13 (trixie) at pin priority 100,"
  echo "install-packages: so that nothing else is upgraded (/etc/apt/sources.list.d/foveate-trixie.list)."
  echo "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] $mirror trixie main" \
    | as_root tee /etc/apt/sources.list.d/foveate-trixie.list >/dev/null
  printf 'Package: *\nPin: release n=trixie\nPin-Priority: 100\n' \
    | as_root tee "$pin" >/dev/null
fi
[[ $old_debian == yes ]] && suite=(-t trixie)
as_root apt-get update -qq
install() { as_root apt-get install -y -qq --no-install-recommends "$@" >/dev/null; }
drivers=() browser=()
for package in "${missing[@]}"; do
  if [[ $package == chromium ]]; then browser+=("$package"); else drivers+=("$package"); fi
done
# The browser comes from the machine's own release, so that it brings no newer libraries along.
[[ ${#drivers[@]} -eq 0 ]] || install "${suite[@]}" "${drivers[@]}"
[[ ${#browser[@]} -eq 0 ]] || install "${browser[@]}"
