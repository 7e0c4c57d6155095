# README's two commands: `make demo` and `make test` set up everything they need in .venv, then run.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test format schemas reference pictures figures fixtures benchmark papers clean \
	coverage reliability mutants lock audit test-minimum test-newest test-package

# `make LOCK=requirements/dev.lock test` takes the locked versions of the development dependencies instead of the newest.
LOCK ?=
LOCKED = $(if $(LOCK),-c $(LOCK))
MINIMUM := numpy==2.0.* scipy==1.13.* pyarrow==17.* typer==0.16.* rich==13.7.* msgspec==0.19.*

.venv/runtime: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	touch $@

.venv/dev: .venv/runtime $(LOCK)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check $(LOCKED) -e '.[dev]'
	touch $@

demo: .venv/runtime ## solve a bundled file of bearings and compare with its truth
	mkdir -p out
	$(BIN)/nlosctl localize --method ml fixtures/good_bearings.parquet -o out/fixes.csv --overwrite
	head -6 out/fixes.csv | cut -d, -f1,2,5,6,13,14,15
	$(BIN)/nlosctl evaluate out/fixes.csv --format text

test: .venv/dev ## lint, format, types, import contract, tests
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest -n auto

format: .venv/dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

schemas: .venv/runtime ## write schemas/ again from contract/tables/
	$(BIN)/nlosctl schema --write schemas

reference: .venv/runtime ## write docs/commands.md and man/nlosctl.1 again from the commands
	$(BIN)/python docs/builders/build_reference.py

pictures: .venv/dev ## make docs/pictures/ again by running the pages that show them
	$(BIN)/python docs/builders/build_pictures.py

figures: .venv/dev ## make the pictures of docs/plotting.md again
	$(BIN)/python docs/figures/build_plots.py

fixtures: .venv/runtime ## make fixtures/ again
	$(BIN)/python fixtures/builders/build_bearings.py
	$(BIN)/python fixtures/builders/build_ranges.py
	$(BIN)/python fixtures/builders/build_over_the_horizon.py
	$(BIN)/python fixtures/builders/build_triplets.py
	$(BIN)/python fixtures/builders/build_formats.py

benchmark: .venv/dev ## all benchmarks, peers too, to benchmarks/results.md and benchmarks/history/
	$(BIN)/python benchmarks/run.py

benchmark-peers: .venv/dev ## only gtsam, pyceres, jax, Stone Soup and scikit-image; the first time installs them (1.5 GB)
	$(BIN)/python benchmarks/peers.py

benchmark-quick: .venv/dev ## only what the limits are on; prints
	$(BIN)/python benchmarks/run.py --quick

benchmark-compare: .venv/dev ## what got slower between the last two runs
	$(BIN)/python benchmarks/history.py

papers: .venv/dev ## run all figures and tables of the papers (an hour at most; goes on where it stopped) and write docs/papers.md
	$(BIN)/nlosctl reproduce all -o out/papers --page docs/papers.md --jobs 0 --overwrite

coverage: .venv/dev ## the tests with coverage by branches, in subprocesses too; fails under 95 %
	$(BIN)/python -m pytest -n auto --cov=nlosctl --cov-report=term-missing

reliability: .venv/dev ## faults, hostile files, fuzzing, kills, numerics, at length: see docs/reliability.md
	$(BIN)/python -m pytest -n auto -m '' tests/reliability
	$(BIN)/python tests/reliability/fuzz_files.py --inputs 100000
	$(BIN)/python tests/reliability/kill_runs.py --kills 200

mutants: .venv/dev ## which small changes of geometry/ and methods/ no test notices
	$(BIN)/python tests/reliability/mutants.py

lock: .venv/dev ## resolve the development dependencies again
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile --universal --upgrade --quiet --python-version 3.11 --all-extras \
		--no-header --no-annotate --output-file requirements/dev.lock pyproject.toml

audit: .venv/dev ## known vulnerabilities of what is locked; asks a service in the net
	$(BIN)/python -m pip install --quiet pip-audit
	$(BIN)/pip-audit --requirement requirements/dev.lock --no-deps --disable-pip --strict

test-minimum: ## the tests with the oldest runtime dependencies that pyproject.toml allows
	$(PYTHON) -m venv .venv/minimum
	.venv/minimum/bin/python -m pip install --quiet $(MINIMUM) -e '.[dev]'
	.venv/minimum/bin/python -m pytest -n auto

test-newest: ## the tests with the newest dependencies there are
	$(PYTHON) -m venv .venv/newest
	.venv/newest/bin/python -m pip install --quiet --upgrade -e '.[dev]'
	.venv/newest/bin/python -m pytest -n auto

test-package: .venv/dev ## build sdist and wheel, install the wheel in an empty environment, try it from there
	rm -rf out/package && mkdir -p out/package
	$(BIN)/python -m pip install --quiet build
	$(BIN)/python -m build --outdir out/package .
	$(PYTHON) -m venv out/package/venv
	out/package/venv/bin/python -m pip install --quiet out/package/*.whl
	out/package/venv/bin/python tests/reliability/installed_package.py fixtures

clean:
	rm -rf .venv benchmarks/.peers out .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
