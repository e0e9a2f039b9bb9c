# Where the scripts put what they install; sourced by them. What is here belongs to one user and this program.
foveate_data=${XDG_DATA_HOME:-${HOME:-$PWD/target}/.local/share}/foveate
# Newer drivers than this release has, unpacked and not installed.
drivers_folder=$foveate_data/drivers
# The same for programs that tests start.
tools_folder=$foveate_data/tools
# The packages that scripts/install-packages.sh has installed.
installed_list=$foveate_data/installed-packages
# What tells cargo of the drivers in this checkout.
cargo_config=$PWD/.cargo/config.toml
# The system's root, which tests have elsewhere.
system=${FOVEATE_TEST_ROOT:-}
udev_rule=$system/etc/udev/rules.d/71-oculus-rift-dk1.rules
# What earlier versions of these scripts left in the system.
old_list=$system/etc/apt/sources.list.d/foveate-trixie.list
old_pin=$system/etc/apt/preferences.d/foveate-trixie
old_monado=$system/usr/local/lib/foveate-monado
old_files=("$system/usr/local/bin/monado-service" "$system/usr/share/openxr/1/openxr_monado.json")
