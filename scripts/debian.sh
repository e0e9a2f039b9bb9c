# Packages of a release of Debian on any Debian or Ubuntu, with lists and caches of their own in $work, so that the system's
# stay as they are.
# Sourced by the scripts that unpack some.

# apt-get for them.
ask() {
  apt-get -qq -o Dir::Etc::SourceList="$work/sources.list" -o Dir::Etc::SourceParts=/dev/null \
    -o Dir::Etc::Preferences=/dev/null -o Dir::Etc::PreferencesParts=/dev/null -o Dir::State="$work/state" \
    -o Dir::State::Status="$work/status" -o Dir::Cache="$work/cache" -o APT::Sandbox::User= \
    -o Acquire::Languages=none -o APT::Install-Recommends=0 "$@"
}

# list_debian CODENAME, after which `ask` knows that release's packages.
list_debian() {
  local release=$1
  local keys=/usr/share/keyrings/debian-archive-keyring.gpg mirror
  [[ -e $keys ]] || { echo "Debian's keys are missing; install debian-archive-keyring" >&2; return 1; }
  # The mirror that this machine already uses for its own release serves others too.
  mirror=$(apt-get indextargets --format '$(REPO_URI)' "Created-By: Packages" | grep -m 1 '/debian/\?$') ||
    mirror=http://deb.debian.org/debian
  mkdir -p "$work/state/lists/partial" "$work/cache/archives/partial"
  : >"$work/status"
  echo "deb [signed-by=$keys] $mirror $release main" >"$work/sources.list"
  ask update || { echo "Debian's list of packages ($release) cannot be fetched from $mirror" >&2; return 1; }
}
