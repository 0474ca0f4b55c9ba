# The whole vocabulary. Every target does its own set-up on a machine with git, make, Python >= 3.11 and cargo.
.PHONY: build demo test bench lint lock docs study fuzz clean
.DEFAULT_GOAL := build

UV := .tools/bin/uv
export UV_PROJECT_ENVIRONMENT := .venv
SYNC := $(UV) sync -q --all-extras
ifdef LOCKED                # the very packages of .ci/requirements.txt, checked by their hashes
SYNC := .ci/sync $(UV)
endif
PYTEST_ARGS ?=

$(UV):
	python3 -m pip install -q --disable-pip-version-check --target .tools uv

build: $(UV)                ## .venv with the package installed in place
	$(SYNC)

demo: build                 ## the packaged mission: table, pictures, replay in uwcoop-demo/
	.venv/bin/uwcoop demo -o uwcoop-demo

test: $(UV)                 ## core tests, then the wheel built and installed, then pytest
	cargo test --locked -q --profile checked -p uwcoop-core
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
	for paper in tan2016 matsuda2017 walls2012; do .venv/bin/uwcoop reproduce $$paper -o reproduced/$$paper || exit 2; done

FUZZ_S ?= 600
fuzz:                       ## hostile packets, events and snapshots for FUZZ_S seconds, overflow checks on
	cargo test --locked -q --profile checked -p uwcoop-core --test navigator_fuzz --test navigator_contract --no-run
	end=$$(( $$(date +%s) + $(FUZZ_S) )); while [ $$(date +%s) -lt $$end ]; do \
		UWCOOP_FUZZ_CASES=1000 cargo test --locked -q --profile checked -p uwcoop-core --test navigator_fuzz || exit 1; \
		UWCOOP_FUZZ_CASES=100 cargo test --locked -q --profile checked -p uwcoop-core --test navigator_contract any_event || exit 1; \
	done

clean:
	rm -rf target .venv dist site uwcoop-demo
