# README's two commands: `make demo` and `make test` set up everything they need in .venv, then run.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test format schemas reference pictures figures fixtures benchmark papers clean

.venv/runtime: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	touch $@

.venv/dev: .venv/runtime
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
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

clean:
	rm -rf .venv benchmarks/.peers out .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
