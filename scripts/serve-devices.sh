#!/usr/bin/env bash
# Serves this machine's OpenCL devices to others: scripts/serve-devices.sh ADDRESS [PORT]. ADDRESS is this
# machine's own, as others reach it. There is no password and no encryption: use it in networks of your own
# only. Ports PORT to PORT+2 (10998 to 11000) have to be open.
set -euo pipefail
cd "$(dirname "$0")/.."
if [[ $# -lt 1 ]]; then
  echo "usage: $0 ADDRESS [PORT]" >&2; exit 2
fi
server=${POCL_REMOTE:-target/pocl-remote}/pocld
if [[ ! -x "$server" ]]; then
  echo "serve-devices: there is no $server; run scripts/build-pocl-remote.sh first" >&2; exit 1
fi
echo "serve-devices: OpenCL devices here, by the numbers that a client uses after the slash:"
clinfo --raw --list 2>/dev/null | grep -v '^Platform' || echo "  (install clinfo to see them)"
exec "$server" -a "$1" -p "${2:-10998}"
