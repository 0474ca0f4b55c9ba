# The whole vocabulary. Every target does its own set-up on a machine with git, make, Python >= 3.11 and cargo.
.PHONY: build demo test bench lint lock docs study papers fuzz hostile sanitize miri wheel clean
.DEFAULT_GOAL := build

UV := .tools/bin/uv
export UV_PROJECT_ENVIRONMENT := .venv
export UV_COMPILE_BYTECODE := 1
SYNC := $(UV) sync -q --all-extras
ifdef LOCKED                # the very packages of .ci/requirements.txt, checked by their hashes
SYNC := .ci/sync $(UV)
endif
PYTEST_ARGS ?=

RUST := 1.89

$(UV):
	@python3 -c 'import sys; sys.exit(sys.version_info < (3, 11) and "uwcoop needs Python 3.11 or newer, python3 is " + sys.version.split()[0])'
	@have=$$(cargo --version 2>/dev/null | cut -d " " -f 2); test -n "$$have" || { echo "uwcoop needs cargo, the Rust build tool, 1.89 or newer: docs/install.md"; exit 1; }; \
	 printf '%s\n' $(RUST) "$$have" | sort -V -C || { echo "uwcoop needs Rust $(RUST) or newer, cargo is $$have: docs/install.md"; exit 1; }
	python3 -m pip install -q --disable-pip-version-check --target .tools uv

build: $(UV)                ## .venv with the package installed in place
	@test -d target/maturin || echo "compiling the Rust core: about 3 minutes on two cores, once"
	$(SYNC)

demo: build                 ## the packaged mission: table, pictures, replay in uwcoop-demo/
	@echo "flying a mission of three vehicles with seven navigators, drawing it and writing its replay: about 20 seconds"
	.venv/bin/uwcoop demo -o uwcoop-demo

test: $(UV)                 ## core tests, then the wheel built and installed, then pytest
	cargo test --locked -q --profile checked -p uwcoop-core
	cargo build --locked -q --profile checked -p uwcoop-capi
	$(SYNC) --no-editable
	.venv/bin/python -m pytest -n auto --dist loadfile $(PYTEST_ARGS)

lint: $(UV)
	$(SYNC)
	cargo fmt --all --check
	cargo clippy --locked -q --workspace --all-targets -- -D warnings
	.venv/bin/ruff format --check .
	.venv/bin/ruff check .
	.venv/bin/mypy
	.venv/bin/python -m mypy.stubtest uwcoop._native
	@if cargo deny --version >/dev/null 2>&1; then cargo deny --offline check bans licenses sources; \
	 else echo "cargo-deny is not installed: tests/test_supply_chain.py holds Cargo.lock against deny.toml"; fi

lock: $(UV)                 ## .ci/requirements.txt anew: versions and hashes of today
	$(UV) lock -q --upgrade
	$(UV) export -q --frozen --all-extras --group dev --no-emit-project --no-header -o .ci/requirements.txt

bench: $(UV)                ## criterion benches, then the side-by-side comparison with NumPy and numba
	$(SYNC) --group bench
	cargo bench --locked -p uwcoop-benches
	.venv/bin/python benches/python/side_by_side.py

docs: $(UV)
	$(SYNC) --group docs
	.venv/bin/mkdocs build --strict

study: build                ## the long tests and the studies behind docs/results
	.venv/bin/python -m pytest -m long
	.venv/bin/python studies/results.py
	.venv/bin/python studies/compare.py --real-runs 8
	.venv/bin/python studies/alternating_landmark.py

PAPER_RUNS ?= 20
papers: build               ## the three papers: docs/results/ and docs/images/ written from what is flown; goes on where it was cut off
	.venv/bin/uwcoop reproduce walls2012 -o reproduced/walls2012 --docs docs
	.venv/bin/uwcoop reproduce matsuda2017 -o reproduced/matsuda2017 --docs docs
	.venv/bin/uwcoop reproduce tan2016 --runs $(PAPER_RUNS) -o reproduced/tan2016 --docs docs

FUZZ_S ?= 600
fuzz:                       ## hostile packets, events and snapshots for FUZZ_S seconds, overflow checks on
	cargo test --locked -q --profile checked -p uwcoop-core --test navigator_fuzz --test navigator_contract --no-run
	end=$$(( $$(date +%s) + $(FUZZ_S) )); while [ $$(date +%s) -lt $$end ]; do \
		UWCOOP_FUZZ_CASES=1000 cargo test --locked -q --profile checked -p uwcoop-core --test navigator_fuzz || exit 1; \
		UWCOOP_FUZZ_CASES=100 cargo test --locked -q --profile checked -p uwcoop-core --test navigator_contract any_event || exit 1; \
	done

PACKETS ?= 10000000
hostile: $(UV)              ## packets by the ten million, forgeries, a day, mutated files, kills, overflow checks on: an hour or two on two cores
	UWCOOP_PACKETS=$(PACKETS) cargo test --locked -q --profile checked -p uwcoop-core --test navigator_hostile -- --ignored --nocapture ten_million
	UWCOOP_PACKETS=$$(( $(PACKETS) / 10 )) cargo test --locked -q --profile checked -p uwcoop-core --test navigator_hostile -- --ignored --nocapture a_million
	cargo test --locked -q --profile checked -p uwcoop-core --test navigator_authenticated -- --ignored
	$(SYNC)
	.venv/bin/python -m pytest -m long tests/importers/test_mutated_files.py tests/charts/test_damaged.py tests/cli/test_killed.py

SANITIZED := --target x86_64-unknown-linux-gnu --target-dir target/sanitized -p uwcoop-core
sanitize:                   ## the kernels and hostile packets under AddressSanitizer (a nightly toolchain)
	@rustc +nightly --version >/dev/null 2>&1 || { echo "make sanitize needs a nightly toolchain: rustup toolchain install nightly"; exit 1; }
	RUSTFLAGS="-Zsanitizer=address" cargo +nightly test --locked -q --profile checked $(SANITIZED) --lib kernels
	RUSTFLAGS="-Zsanitizer=address" cargo +nightly test --locked -q --profile checked $(SANITIZED) --test navigator_hostile

miri:                       ## the kernels' scalar baseline under Miri (a nightly toolchain with miri and rust-src)
	@cargo +nightly miri --version >/dev/null 2>&1 || { echo "make miri needs Miri: rustup toolchain install nightly --component miri,rust-src"; exit 1; }
	MIRIFLAGS=-Zmiri-disable-isolation cargo +nightly miri test --locked -p uwcoop-core --lib kernels::lookup kernels::pattern

wheel: $(UV)                ## dist/: a manylinux wheel and the source distribution of HEAD, checked and tried alone
	rm -rf dist && mkdir -p dist/tree
	git archive HEAD | tar -x -C dist/tree
	dist/tree/.ci/absolute-links dist/tree/README.md
	cd dist/tree && CARGO_TARGET_DIR=../../target $(CURDIR)/$(UV) tool run -q --from 'maturin[zig]>=1.13,<2' \
		maturin build --release --locked --zig --compatibility manylinux_2_28 --out ..
	cd dist/tree && $(CURDIR)/$(UV) tool run -q --from 'maturin>=1.13,<2' maturin sdist --out ..
	rm -rf dist/tree
	$(UV) tool run -q twine check --strict dist/*.whl dist/*.tar.gz
	$(UV) venv -q dist/alone && $(UV) pip install -q --python dist/alone/bin/python "$$(ls dist/*.whl)[figures]"
	dist/alone/bin/uwcoop demo -o dist/uwcoop-demo
	ls -l dist

clean:
	rm -rf target .venv dist site uwcoop-demo
