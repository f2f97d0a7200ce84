# Everything a checkout needs is made on demand: system packages and virtual environments by scripts/setup.

DEV := $(CURDIR)/.venv-4.2
PYTHON := $(DEV)/bin/python
# Blender versions that the tests run on; those whose Python is not here are skipped with a message, but not where CI is set.
# The newest and the oldest run most tests and come first: they take longest.
BLENDERS ?= 5.3 4.2 4.5 5.0 5.2
WHEELS := $(CURDIR)/build/wheels
SCENES := $(or $(RELUME_SCENES),$(CURDIR)/../shared/scenes)

# The build of rust/gather links against OIDN; tests and the command line load it from the same place.
export OIDN_DIR := $(DEV)/lib/python3.11/site-packages/pyoidn/oidn
# Mesa's layer that picks a GPU by the desktop complains where there is none.
export NODEVICE_SELECT := 1
TIMED := $(CURDIR)/scripts/timed
CARGO := env LD_LIBRARY_PATH=$(OIDN_DIR)/lib cargo
# Benchmarks are tested by name: cargo test -p relume-bench. The fuzz targets, which clippy compiles, have no tests, but would have
# crates built with other features than the wheel's, so that all of it is compiled twice.
TESTED := --workspace --exclude relume-bench --exclude relume-fuzz
# CI sets these to --release and --native: tests and the wheel are then of the same build, which is half as much to compile.
PROFILE ?=
WHEEL ?=
NEWEST_DRIVER := CARGO_TARGET_X86_64_UNKNOWN_LINUX_GNU_RUNNER=$(CURDIR)/scripts/on-newest-driver

.PHONY: setup check deny wheel extension extension-linux test test-long test-named test-rust rust-here rust-on-newest-driver test-python test-blender window window-built guide fuzz demo shots parity coverage quality bench bench-gpu solve cases hunt clean

setup:
	@$(TIMED) set-up scripts/setup

# What takes less than a minute once it is built: run it before each commit.
check: setup check-rust check-python
	$(CARGO) test --quiet -p relume-gpu $(PROFILE) --lib -- valid metal_and_directx
	$(PYTHON) -m pytest --quiet tests/test_architecture.py tests/test_documents.py

check-rust: setup
	$(CARGO) fmt --all --check
	$(TIMED) clippy $(CARGO) clippy --workspace --all-targets $(PROFILE) -- -D warnings
	$(TIMED) "clippy of the GPU's tests" $(CARGO) clippy --workspace --test gpu $(PROFILE) -- -D warnings

check-python: setup
	$(PYTHON) -m ruff check addon blend_tests examples tests rust/python scripts
	$(PYTHON) -m mypy

# Licences, sources and advisories of all crates (deny.toml). Advisories come over the network, so that CI leaves it out.
deny:
	@cargo deny --version >/dev/null 2>&1 || { echo "make deny: cargo-deny is not installed: cargo install cargo-deny --locked" >&2; exit 1; }
	cargo deny check

wheel: setup
	@$(TIMED) wheel scripts/build-wheel "$(WHEELS)" $(WHEEL)

# The zip for Linux, which is what tests run.
extension-linux: wheel
	@scripts/build-extension build/extension "$(WHEELS)"

# A zip for each platform.
extension: wheel
	@scripts/setup windows
	@scripts/setup macos
	@scripts/setup macos-intel
	@scripts/build-wheel "$(WHEELS)-windows" --windows
	@scripts/build-wheel "$(WHEELS)-macos" --macos
	@scripts/build-wheel "$(WHEELS)-macos-intel" --macos-intel
	@scripts/build-extension build/extension "$(WHEELS)" "$(WHEELS)-windows" "$(WHEELS)-macos" "$(WHEELS)-macos-intel"

# What is downloaded for the later parts is fetched while the first ones compile; whoever needs it waits for it, or fetches it anew.
# Blenders, and the tests of the newest driver beside them, run three at a time: each waits now and then, for a disk, a timer, or a
# training that yields to all else.
test: setup
	@{ scripts/window/setup; scripts/setup $(BLENDERS); } >/dev/null 2>&1 &
	@$(MAKE) --no-print-directory check-python check-rust rust-here test-python extension-linux
	@printf '%s\n' rust-on-newest-driver $(BLENDERS:%=blender-%) | xargs -P 3 -I PART $(MAKE) --no-print-directory PART
	@$(MAKE) --no-print-directory window-built AT_ONCE=3

# All tests, as before a release: hours on two cores. `.ci/run long` runs it.
test-long: test test-named

# What is run by name alone: a bake under real farm managers, tests of half a minute and more, those of the benchmarks, and all
# scenarios of the window. What this machine lacks is skipped and said.
test-named: extension-linux
	@scripts/setup 5.3
	@scripts/install-wheel "$(WHEELS)" 4.2 5.3
	$(TIMED) "farm managers" $(PYTHON) -m pytest -rs tests/farm_managers.py
	$(TIMED) "slow tests in Blender" .venv-5.3/bin/python -m pytest -rs blend_tests -m slow
	$(TIMED) "long solves" $(CARGO) test -p relume-session --test solve $(PROFILE) -- --ignored
	$(TIMED) "tests of benchmarks" $(CARGO) test -p relume-bench $(PROFILE)
	@$(MAKE) --no-print-directory window-built WINDOW=--all

test-rust: check-rust
	@$(MAKE) --no-print-directory rust-here rust-on-newest-driver

# What takes minutes on a software driver is tested by name; scripts/gpu-check runs all of it on a card. Tests of matrices are for
# the newest driver.
rust-here:
	$(TIMED) "Rust tests" $(CARGO) test $(TESTED) $(PROFILE) -- --skip matrices \
		--skip a_pool_on_the_device_trains_as_one_that_is_not --skip weight_gradients_equal_difference_quotients_of_the_device
	@[ -z "$$CI" ] || rm -rf target/tmp

# On a driver with matrices, with the kernels of shipped builds, which check nothing: tests of matrices, and those of the whole chain.
rust-on-newest-driver:
	RELUME_GPU_UNCHECKED=1 $(NEWEST_DRIVER) $(TIMED) "newest driver" $(CARGO) test $(TESTED) $(PROFILE) --lib -- matrices
	RELUME_GPU_UNCHECKED=1 RELUME_VALIDATE=1 $(NEWEST_DRIVER) $(TIMED) "GPU chain" $(CARGO) test $(TESTED) $(PROFILE) --test gpu

test-python: wheel check-python
	@scripts/install-wheel "$(WHEELS)" 4.2
	$(TIMED) tests $(PYTHON) -m pytest tests

test-blender: extension-linux
	@printf '%s\n' $(BLENDERS) | xargs -P 3 -I VERSION $(MAKE) --no-print-directory blender-VERSION

# With the wheel that is built.
blender-%:
	@$(TIMED) "Blender $*" scripts/test-blender "$(WHEELS)" $*

# A real Blender with its window, on a virtual display; WINDOW="smoke" for less, AT_ONCE=2 for two side by side, which disturbs their
# times. Needs root, for chroot.
window: extension-linux
	@$(MAKE) --no-print-directory window-built

# With the extension that is built.
window-built:
	@RELUME_SCENES="$(SCENES)" $(TIMED) window $(PYTHON) scripts/window/run.py --at-once $(or $(AT_ONCE),1) $(WINDOW)

# The pictures of docs/guide.md, taken anew.
guide: extension-linux
	@$(PYTHON) scripts/window/run.py guide
	@$(PYTHON) scripts/guide.py

# Hostile bytes into every reader; FUZZ="300 shard" for other seconds and targets.
fuzz: wheel
	@scripts/install-wheel "$(WHEELS)" 4.2
	@scripts/fuzz $(FUZZ)

demo: wheel
	@scripts/install-wheel "$(WHEELS)" 4.2
	$(PYTHON) scripts/demo/run.py $(DEMO)

# Real shots from end to end; SHOTS="my.blend --seconds 600" for your own.
shots: wheel
	@scripts/install-wheel "$(WHEELS)" 4.2
	RELUME_SCENES="$(SCENES)" $(PYTHON) scripts/shots.py $(SHOTS)

quality: wheel
	@scripts/install-wheel "$(WHEELS)" 4.2
	RELUME_SCENES="$(SCENES)" $(PYTHON) scripts/quality.py $(QUALITY)

# Peers (Mitsuba, PyTorch) live in an environment of their own, made here.
bench: wheel
	@scripts/setup peers
	@scripts/install-wheel "$(WHEELS)" 4.2
	$(CARGO) build --release -p relume-bench
	RELUME_SCENES="$(SCENES)" $(PYTHON) scripts/bench/run.py --peers $(CURDIR)/.venv-peers/bin/python $(BENCH)

# Lights found again, against the paper's and Mitsuba's; SOLVE="--table 3 --scenes cornell_box --runs 1" for less.
solve: wheel
	@scripts/setup peers
	@scripts/install-wheel "$(WHEELS)" 4.2
	$(PYTHON) -m pytest --quiet scripts/bench/solve
	RELUME_SCENES="$(SCENES)" $(PYTHON) scripts/bench/solve/run.py --peers $(CURDIR)/.venv-peers/bin/python $(SOLVE)

# Tests and times a graphics card (scripts/gpu-check). BENCH_GPU="--keep MACHINE" keeps the figures in docs/bench;
# "--from FILE" takes those of a run elsewhere; "--software" takes a software driver; with --quality "--seconds 300 --types sphere"
# proxies are trained on the real scenes as well.
bench-gpu: wheel
	@scripts/install-wheel "$(WHEELS)" 4.2
	RELUME_SCENES="$(SCENES)" $(PYTHON) scripts/bench/graphics.py $(BENCH_GPU)

# Against Cycles on the real scenes; PARITY="--scenes cornell_box --sets 2" for less, "--features --version 5.3" for the scenes of one
# feature in another Blender. Keeps docs/bench/parity.json and the page beside it.
parity: wheel
	@scripts/install-wheel "$(WHEELS)" $(BLENDERS)
	$(PYTHON) scripts/parity/run.py --folder "$(SCENES)" $(PARITY)

# Table of every shader node and setting, and of what becomes of it, from the oldest and the newest Blender that are here.
coverage: setup
	$(PYTHON) scripts/coverage.py

# Small files that strangers might make, against Cycles in the oldest, the next and the newest Blender that are set up here;
# CASES="--only 83 --version 5.3" for less. Keeps docs/bench/cases.json and the page beside it.
cases: wheel
	@scripts/install-wheel "$(WHEELS)" $(BLENDERS)
	@$(PYTHON) scripts/cases.py $(CASES)

# Random scenes against Cycles in the oldest and the newest Blender that are set up here; HUNT="--kinds graphs,lamps --seed 2
# --rounds 1000 --version 5.3" for others. Prints each round that fails with the command that plays it alone.
hunt: wheel
	@scripts/install-wheel "$(WHEELS)" $(BLENDERS)
	@$(PYTHON) scripts/hunt/hunt.py $(HUNT)

clean:
	rm -rf build out target
