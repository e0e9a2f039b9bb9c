#!/usr/bin/env bash
# Makes ready what foveate needs beside Rust, on Debian and Ubuntu:
#   scripts/install-packages.sh demo    OpenCL and Vulkan where no driver works (PoCL, lavapipe), and keyboards of windows
#   scripts/install-packages.sh test    the same, and what the tests start
#   scripts/install-packages.sh bench   the same as demo, and what benchmarks compare with (Embree 4, a C++ compiler)
#   scripts/install-packages.sh remote  the same as demo, and what PoCL's network driver is built with
#   scripts/install-packages.sh hid     the virtual machine of scripts/test-hid.sh
# Packages come from this release's own archive. What is too old there is not installed: Debian 13's is unpacked
# into a folder of this user's, for this program alone (scripts/unpack-drivers.sh). Does nothing when all is there;
# uses sudo where packages are to be installed and it is not run by root. `make uninstall` undoes it.
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/places.sh

say() { echo "install-packages: $*"; }
fail() { echo "install-packages: $*" >&2; exit 1; }

loaders=(ocl-icd-libopencl1 libvulkan1)
demo=(g++ "${loaders[@]}" libxkbcommon0 libxkbcommon-x11-0)
test=("${demo[@]}" vulkan-validationlayers xvfb x11-apps)
hid=(qemu-system-x86 binutils xz-utils)
# The report page is tested in a browser; Ubuntu offers this one as a snap only, which wants more than apt.
{ . /etc/os-release; } 2>/dev/null || true
[[ "${ID:-}" == ubuntu ]] || test+=(chromium)
remote=("${demo[@]}" cmake git g++ make patch pkg-config ocl-icd-dev ocl-icd-opencl-dev clinfo)
# What has to be this new, and is unpacked where the release has it older or not at all.
declare -A floors=([pocl-opencl-icd]=6 [mesa-vulkan-drivers]=25 [libopenxr-loader1]=1.1
  [openxr-layer-corevalidation]=1.1 [monado-service]=25 [libopenxr1-monado]=25 [libembree-dev]=4)

drivers=yes new=()
case "${1:-demo}" in
  demo) wanted=("${demo[@]}") ;;
  # An OpenXR runtime with a simulated headset: its service, and what it loads into programs.
  test) wanted=("${test[@]}") new=(libopenxr-loader1 openxr-layer-corevalidation monado-service libopenxr1-monado) ;;
  bench) wanted=("${demo[@]}" g++) new=(libembree-dev) ;;
  remote) wanted=("${remote[@]}") ;;
  hid) wanted=("${hid[@]}") drivers=no ;;
  *) echo "usage: $0 [demo|test|bench|remote|hid]" >&2; exit 2 ;;
esac

if ! command -v apt-get >/dev/null; then
  say "this is not Debian or Ubuntu; install an OpenCL and a Vulkan driver yourself (for the CPU: PoCL and Mesa's lavapipe)." >&2
  exit 0
fi

as_root() {
  if [[ $EUID -eq 0 ]]; then "$@"; return; fi
  command -v sudo >/dev/null || fail "run this as root (there is no sudo): $*"
  sudo "$@"
}

version() { { dpkg-query -W -f '${db:Status-Status} ${Version}' "$1" 2>/dev/null || true; } | sed -n 's/^installed //p'; }
# Epochs say nothing of what is inside.
at_least() { [[ -n $1 && $1 != "(none)" ]] && dpkg --compare-versions "${1#*:}" ge "$2"; }

updated=no
update() {
  [[ $updated == yes ]] && return
  updated=yes
  as_root apt-get update -qq || fail "the lists of packages cannot be fetched; see what apt-get says above"
}

# Installs packages of this release, and notes which are new for `make uninstall`.
install_own() {
  [[ $# -gt 0 ]] || return 0
  update
  local plan fresh newer uris
  export DEBIAN_FRONTEND=noninteractive
  plan=$(apt-get -s -qq install --no-remove --no-install-recommends "$@") ||
    fail "$* cannot be installed without removing other packages; see: apt-get -s install $*"
  fresh=$(awk '/^Inst/ && $3 !~ /^\[/ { print $2 }' <<<"$plan")
  newer=$(awk '/^Inst/ && $3 ~ /^\[/ { print $2 }' <<<"$plan" | tr '\n' ' ')
  uris=$(apt-get -qq -y --print-uris install --no-install-recommends "$@")
  say "installing $* from this release: $(wc -w <<<"$fresh") packages, $(awk '{ bytes += $3 } END { printf "%.0f", bytes / 1e6 }' <<<"$uris") MB to download"
  [[ -z $newer ]] || say "these depend on updates of the same release, which come with them: $newer"
  mkdir -p "$foveate_data"
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-remove --no-install-recommends "$@" >/dev/null
  { cat "$installed_list" 2>/dev/null || true; echo "$fresh"; } | sort -u >"$installed_list.new"
  mv "$installed_list.new" "$installed_list"
}

# Whether apt would remove installed packages for one that is to be new: of those the user has newer ones.
removes() {
  update
  local plan
  # Read whole: a reader that leaves early ends apt with a signal, which pipefail takes for a no.
  plan=$(apt-get -s -qq install --no-install-recommends "$1" 2>/dev/null) || true
  grep -q '^Remv' <<<"$plan"
}

missing=() tools=()
for package in "${wanted[@]}"; do
  if [[ -n $(version "$package") ]]; then continue; fi
  if [[ $package == qemu-system-x86 ]] && removes "$package"; then tools+=("$package"); else missing+=("$package"); fi
done
if [[ ${#tools[@]} -gt 0 ]]; then scripts/unpack-drivers.sh --tools "${tools[@]}"; fi
install_own "${missing[@]}"

# Which of opencl and vulkan work here, asked of the loaders as the program asks them, without what is unpacked.
working=""
if [[ $drivers == yes ]]; then
  command -v cc >/dev/null || fail "a C linker is missing, which Rust needs too; install build-essential"
  probe=$(mktemp -d)
  trap 'rm -rf "$probe"' EXIT
  cc -O0 -w -o "$probe/probe" scripts/probe-drivers.c -ldl
  for kind in opencl vulkan; do
    # A driver that crashes or hangs does not work.
    if timeout 60 env -u OCL_ICD_VENDORS -u VK_DRIVER_FILES "$probe/probe" "$kind" >/dev/null 2>&1; then working+=" $kind "; fi
  done
  [[ $working == *" opencl "* ]] || new+=(pocl-opencl-icd)
  [[ $working == *" vulkan "* ]] || new+=(mesa-vulkan-drivers)
fi

own=() aside=()
for package in "${new[@]}"; do
  at_least "$(version "$package")" "${floors[$package]}" && continue
  # Where an older script has unpacked Monado.
  [[ $package == *monado* && -e $old_monado/complete ]] && continue
  if grep -qxF "$package" "$drivers_folder/asked" 2>/dev/null; then aside+=("$package"); continue; fi
  update
  candidate=$(apt-cache policy "$package" | sed -n 's/^ *Candidate: //p')
  # An older script of this project added Debian 13's archive, which is not this release's own.
  if [[ ! -e $old_list ]] && at_least "$candidate" "${floors[$package]}"; then own+=("$package"); else aside+=("$package"); fi
done
install_own "${own[@]}"
# Debian 13's packages are proven by Debian's keys, which Ubuntu has in a package.
if [[ ${#aside[@]} -gt 0 && ! -e /usr/share/keyrings/debian-archive-keyring.gpg ]]; then install_own debian-archive-keyring; fi
if [[ $drivers == yes ]]; then scripts/unpack-drivers.sh "${aside[@]}"; fi
