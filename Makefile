# README's two commands: `make demo` and `make test` set up everything they need in .venv, then run.
# `make test PYTHON=python3.13` makes .venv again with another Python; `JOBS=2` runs the tests in two processes.
PYTHON ?= python3
# One process more than CPUs, because some tests wait for other processes.
JOBS ?= $(shell expr $$(getconf _NPROCESSORS_ONLN) + 1)
PYTEST := -m pytest -n $(JOBS) --dist loadgroup
BIN := .venv/bin
RUNTIME := .venv/runtime-$(notdir $(PYTHON))
DEV := .venv/dev-$(notdir $(PYTHON))
LOCK := requirements/dev.lock
# Tests start the program hundreds of times: without bytecode each start would compile all modules.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-fast format schemas reference figures fixtures benchmark benchmark-peers benchmark-quick \
	benchmark-compare papers clean coverage reliability mutants chosen-mutants lock audit test-minimum test-newest test-package

# The oldest runtime dependencies that pyproject.toml allows.
MINIMUM := numpy==2.0.* scipy==1.13.* pyarrow==18.* typer==0.26.* rich==13.8.* msgspec==0.19.*

$(RUNTIME): pyproject.toml $(LOCK)
	$(PYTHON) -m venv --clear .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c $(LOCK) -e .
	touch $@

$(DEV): $(RUNTIME)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c $(LOCK) -e '.[dev]'
	touch $@

demo: $(RUNTIME) ## solve a bundled file of bearings and compare with its truth
	mkdir -p out
	$(BIN)/nlosctl localize --method ml fixtures/good_bearings.parquet -o out/fixes.csv --overwrite
	head -6 out/fixes.csv | cut -d, -f1,2,5,6,13,14,15
	$(BIN)/nlosctl evaluate out/fixes.csv --format text

test: $(DEV) ## lint, format, types, import contract, tests, with the locked dependencies
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python $(PYTEST)

FAST := geometry models contract solvers methods scenarios evaluation pipeline registry

test-fast: $(DEV) ## the tests of the folders that compute, those that start no process and take little time: seconds
	$(BIN)/python -m pytest -q -n 2 -m 'not process and not extensive and not slow' $(FAST:%=tests/%)

format: $(DEV)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

schemas: $(RUNTIME) ## write schemas/ again from contract/tables/
	$(BIN)/nlosctl schema --write schemas

reference: $(RUNTIME) ## write docs/commands.md and man/nlosctl.1 again from the commands
	$(BIN)/python docs/builders/build_reference.py

figures: $(DEV) ## draw docs/figures/ again (except those of docs/papers.md) by running the pages that show them
	$(BIN)/python docs/builders/build_figures.py
	$(BIN)/python docs/builders/build_circle_regions.py

fixtures: $(RUNTIME) ## make fixtures/ again
	$(BIN)/python fixtures/builders/build_bearings.py
	$(BIN)/python fixtures/builders/build_ranges.py
	$(BIN)/python fixtures/builders/build_over_the_horizon.py
	$(BIN)/python fixtures/builders/build_triplets.py
	$(BIN)/python fixtures/builders/build_space.py
	$(BIN)/python fixtures/builders/build_arrivals.py
	$(BIN)/python fixtures/builders/build_formats.py
	$(BIN)/python fixtures/builders/build_arrival_logs.py

benchmark: $(DEV) ## all benchmarks, peers too, to benchmarks/results.md and benchmarks/history/
	$(BIN)/python benchmarks/run.py

benchmark-peers: $(DEV) ## only gtsam, pyceres, jax, Stone Soup and scikit-image; the first time installs them (1.5 GB)
	$(BIN)/python benchmarks/peers.py

benchmark-quick: $(DEV) ## only the benchmarks with limits; prints the results
	$(BIN)/python benchmarks/run.py --quick

benchmark-compare: $(DEV) ## list what became slower between the last two runs
	$(BIN)/python benchmarks/history.py

papers: $(DEV) ## run all figures and tables of the papers (an hour at most; continues an interrupted run) and write docs/papers.md
	$(BIN)/nlosctl reproduce all -o out/papers --page docs/papers.md --jobs 0 --overwrite

coverage: $(DEV) ## the tests with coverage by branches, in subprocesses too; fails under 95 %
	$(BIN)/python $(PYTEST) --cov=nlosctl --cov-report=term-missing

reliability: $(DEV) ## long runs with faults, hostile files, fuzzing, kills and extreme numbers: see docs/reliability.md
	$(BIN)/python $(PYTEST) -m '' tests/reliability
	$(BIN)/python tests/reliability/fuzz_files.py --inputs 100000
	$(BIN)/python tests/reliability/kill_runs.py --kills 200

MUTANTS ?= 'nlosctl.geometry.*' 'nlosctl.methods.*'

mutants: $(DEV) ## mutation test of geometry/ and methods/ (hours the first time), or of MUTANTS='nlosctl.evaluation.*'; continues
	$(BIN)/python -m pip install --quiet -c $(LOCK) mutmut==3.8.1
	$(BIN)/mutmut run $(MUTANTS)
	$(BIN)/mutmut results

chosen-mutants: $(DEV) ## faults of meaning, one by one: the fast tests must notice each
	$(BIN)/python tests/reliability/chosen_mutants.py

lock: $(DEV) ## resolve the development dependencies again
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile --universal --fork-strategy fewest --upgrade --quiet --python-version 3.11 --all-extras \
		--no-header --no-annotate --output-file requirements/dev.lock pyproject.toml

audit: $(DEV) ## known vulnerabilities of the locked packages; needs a network
	$(BIN)/python -m pip install --quiet pip-audit
	$(BIN)/pip-audit --requirement requirements/dev.lock --no-deps --disable-pip --strict

test-minimum: ## the tests with the oldest runtime dependencies that pyproject.toml allows
	$(PYTHON) -m venv --clear out/minimum
	out/minimum/bin/python -m pip install --quiet --disable-pip-version-check $(MINIMUM) -e '.[dev]'
	out/minimum/bin/python $(PYTEST)

test-newest: ## the tests with the newest dependencies
	$(PYTHON) -m venv --clear out/newest
	out/newest/bin/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	out/newest/bin/python $(PYTEST)

test-package: $(DEV) ## build sdist and wheel, install the wheel in an empty environment, try it from there
	rm -rf out/package && mkdir -p out/package
	$(BIN)/python -m pip install --quiet build
	$(BIN)/python -m build --outdir out/package .
	$(PYTHON) -m venv out/package/venv
	out/package/venv/bin/python -m pip install --quiet out/package/*.whl
	out/package/venv/bin/python tests/reliability/installed_package.py fixtures

clean:
	rm -rf .venv benchmarks/.peers out mutants .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
