#!/usr/bin/env bash
# Proves that a command leaves installed packages as they are: scripts/check-packages.sh COMMAND... runs it, and fails
# where a package that was installed before has another version afterwards or is gone. Updates that this release's own
# archive offers, which new packages may depend on, are told and let pass.
set -euo pipefail

list() { dpkg-query -W -f '${db:Status-Status} ${Package}:${Architecture} ${Version}\n' | sed -n 's/^installed //p' | sort; }
command -v dpkg-query >/dev/null || exec "$@"
before=$(mktemp)
trap 'rm -f "$before"' EXIT
list >"$before"
status=0
"$@" || status=$?

wrong=0
while read -r package old new; do
  release=$(. /etc/os-release && echo "${VERSION_CODENAME:-}")
  if [[ -n $new ]] && [[ -n $(apt-cache madison "$package" | grep -F "| $new |" | grep " $release[-/]\?") ]]; then
    echo "check-packages: $package was updated from $old to $new within this release"
  else
    echo "check-packages: $package $old is ${new:-gone} now" >&2
    wrong=1
  fi
done < <(join -a 1 "$before" <(list) | awk '$2 != $3')
[[ $wrong -eq 1 ]] || echo "check-packages: of $(wc -l <"$before") packages none was changed by another release"
[[ $status -ne 0 ]] && exit "$status"
exit "$wrong"
