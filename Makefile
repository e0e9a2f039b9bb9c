# The commands that people run; `make help` lists them.

SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.PHONY: help demo test test-long accuracy test-remote test-hid bench bench-fleet trade gpu-check-bundle lint install-udev uninstall

# rustup installs here, and not every shell has it in its path; udevadm hides in sbin.
export PATH := $(PATH):$(HOME)/.cargo/bin:/usr/sbin:/sbin

RULES := 71-oculus-rift-dk1.rules

need_cargo = command -v cargo >/dev/null || { \
  echo "make: cargo is missing; install Rust with rustup (https://rustup.rs) and run make again." >&2; exit 1; }

help: ## List the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo: ## Install what it needs, build, and run the demo; ARGS="--json" passes arguments on
	@$(need_cargo)
	scripts/install-packages.sh demo
	cargo build --release
	./target/release/foveate demo $(ARGS)

uninstall: ## Undo what demo, test and the others have installed or unpacked
	scripts/uninstall.sh

test: ## Install what the tests need and run all of them; ARGS="--test foveation" chooses
	@$(need_cargo)
	scripts/install-packages.sh test
	scripts/run-tests.sh $(ARGS)

test-long: ## Run the checks that take too long for make test: 10^8 rays that must hit or miss, kernels for every combination of features
	@$(need_cargo)
	scripts/install-packages.sh test
	scripts/run-long-tests.sh $(ARGS)

accuracy: ## Measure each stage of the kernels against double precision, and what its repairs cost
	@$(need_cargo)
	scripts/install-packages.sh test
	cargo test --test kernels -- --include-ignored --nocapture --test-threads=1 every_stage accuracy_

.PHONY: test-opencl
test-opencl: ## Kernels and frames on other OpenCL compilers, unpacked aside: rusticl and Intel's; ARGS=frames leaves kernel tests out
	@$(need_cargo)
	scripts/install-packages.sh demo
	cargo build
	scripts/test-opencl.sh $(ARGS)

.PHONY: gpu-static
gpu-static: ## What kernels would take of NVIDIA's and AMD's cards, by their compilers, and whether that is allowed; no card is needed
	@$(need_cargo)
	scripts/gpu-static.sh

.PHONY: check-bounds
check-bounds: ## Kernels' tests with each OpenCL buffer between pages that nobody may touch: what leaves one crashes
	@$(need_cargo)
	scripts/install-packages.sh test
	cargo test --test bounds
	OPENCL_LAYERS=$(CURDIR)/target/debug/deps/libguarded_buffers.so cargo test --test kernels $(ARGS)

.PHONY: check-races
check-races: ## Kernels under Oclgrind, which tells of races, and of what leaves buffers; some minutes
	@$(need_cargo)
	scripts/install-packages.sh test
	cargo build
	scripts/check-races.sh

test-remote: ## Build PoCL-R, and share frames with two servers on this machine, one of which is killed
	@$(need_cargo)
	scripts/install-packages.sh remote
	cargo build
	scripts/test-remote.sh

test-hid: ## Read a virtual Rift DK1 in a real kernel (QEMU; Debian)
	@$(need_cargo)
	scripts/test-hid.sh

bench: ## Measure frames, and rays beside Embree and obvhs; ARGS="--scenes demo" goes to the first, RAYS="--scenes sponza" to the second
	@$(need_cargo)
	scripts/install-packages.sh bench
	cargo bench --bench frame -- $(ARGS)
	cargo bench --bench speed -- $(RAYS)

gpu-check-bundle: ## Pack what scripts/gpu-check.sh needs on a machine with a GPU and nothing but its driver
	@$(need_cargo)
	scripts/gpu-check.sh pack out/gpu-check.tar.gz

bench-fleet: ## Measure what sharing frames costs and gains; ARGS="--frames 12" passes arguments on
	@$(need_cargo)
	scripts/install-packages.sh demo
	cargo bench --bench fleet -- $(ARGS)

.PHONY: bench-headset
bench-headset: ## Measure what a headset costs beside tracing, on Monado; ARGS="--frames 600" passes arguments on
	@$(need_cargo)
	scripts/install-packages.sh test
	cargo bench --bench headset -- $(ARGS)
	cargo bench --bench correction

trade: ## Measure what speed costs on four scenes; ARGS="--quick" takes a few minutes, else hours
	@$(need_cargo)
	scripts/install-packages.sh demo
	cargo build --release
	scripts/measure-trade.sh $(ARGS)

.PHONY: dist
dist: ## Build a tar.gz and a .deb for other machines into out/dist
	@$(need_cargo)
	scripts/dist.sh

.PHONY: dist-windows
dist-windows: ## Pack foveate.exe, OpenXR's loader and what belongs to them into a zip in out/dist
	@$(need_cargo)
	scripts/dist-windows.sh

.PHONY: test-faults
test-faults: ## Kill it at renames, fill disks, take memory away, lose devices and runtimes; ARGS=renames chooses among the first
	@$(need_cargo)
	scripts/install-packages.sh test
	cargo build
	scripts/test-faults.sh $(ARGS)
	cargo test --test fleet
	cargo test --test openxr_scripted -- losses hangs faults

.PHONY: fuzz
fuzz: ## Feed everything that reads files with what coverage finds: SECONDS=60 for each target, ARGS="gltf tree" chooses (nightly, cargo-fuzz)
	@$(need_cargo)
	SECONDS_EACH=$(or $(SECONDS),60) scripts/fuzz.sh $(ARGS)

.PHONY: windows-check
windows-check: ## Check that the program compiles for Windows (needs that target's std)
	@$(need_cargo)
	scripts/windows.sh check

.PHONY: windows
windows: ## Build foveate.exe (needs that target's std and MinGW's compilers)
	@$(need_cargo)
	scripts/windows.sh build

.PHONY: test-windows
test-windows: ## Try foveate.exe under Wine: devices, pictures, a window, a headset on the tests' runtime (Wine, Xvfb)
	@$(need_cargo)
	cargo build
	scripts/test-windows.sh

lint: ## Check format, lints, each feature alone, documentation and crates (needs the rustfmt and clippy components, and cargo-deny)
	@$(need_cargo)
	cargo fmt --all --check
	cargo clippy --workspace --all-targets -- -D warnings
	for feature in '' openxr dk1 window; do \
	  cargo clippy --lib --bins --examples --no-default-features --features "$$feature" -- -D warnings || exit 1; \
	done
	RUSTDOCFLAGS=-Dwarnings cargo doc --no-deps
	scripts/check-crates.sh

install-udev: ## Let this seat's user open the tracker of a Rift DK1
	@as_root=; \
	if [[ $$(id -u) -ne 0 ]]; then \
	  command -v sudo >/dev/null || { echo "make: run this as root; there is no sudo here." >&2; exit 1; }; \
	  as_root=sudo; \
	fi; \
	$$as_root install -D -m 644 configs/$(RULES) /etc/udev/rules.d/$(RULES); \
	echo "make: installed /etc/udev/rules.d/$(RULES)"; \
	if ! command -v udevadm >/dev/null; then \
	  echo "make: there is no udevadm here; the rule holds where udev runs."; \
	elif $$as_root udevadm control --reload; then \
	  echo "make: udev has read it; unplug the tracker and plug it in again."; \
	else \
	  echo "make: udev does not run now; the rule holds from its next start."; \
	fi
