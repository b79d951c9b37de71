# make demo and make test set up everything by themselves: a virtual environment in .venv with the tested versions.
PYTHON ?= python3
BIN := .venv/bin
JOBS ?= 2
PROOF ?= results/proof-quick
PYTEST := $(BIN)/python -m pytest -n auto --maxprocesses 4 --dist worksteal

.PHONY: demo test test-slow oldest newest interop notebooks coverage coverage-kernels bench properties kills proof proof-quick recordings \
	docs docs-serve lint wheel clean

demo: .venv/installed
	$(BIN)/cablebench demo --out results

test: .venv/installed
	$(PYTEST) -m "not slow"

test-slow: .venv/installed
	$(PYTEST)

# the oldest and the newest versions that pyproject.toml allows, each in an environment of its own, without
# constraints.txt; torch stays as pinned, as others are not everywhere to be had for the CPU alone. Warnings are there
# about what has changed since in other libraries
oldest: RESOLUTION := lowest-direct
newest: RESOLUTION := highest
oldest newest:
	test -x build/$@/bin/python || $(PYTHON) -m venv build/$@
	build/$@/bin/python -m pip install --quiet --disable-pip-version-check uv
	sed -n '/^torch==/p' constraints.txt > build/$@/torch.txt
	build/$@/bin/uv pip install --quiet --python build/$@/bin/python --resolution $(RESOLUTION) \
		--overrides build/$@/torch.txt --editable '.[dev]'
	build/$@/bin/python -m pytest -n auto --maxprocesses 4 --dist worksteal -m "not slow" -W ignore::DeprecationWarning

# other projects' own tests and libraries on these environments (docs/interop.md); fetches them into build/interop
interop: .venv/installed
	$(BIN)/python -m tests.interop.peers

# the notebooks of examples/notebooks, from their first cell to the last
notebooks: .venv/installed
	$(BIN)/python -m pytest -n 0 tests/examples/test_notebooks.py

# in the terminal and, line by line, in results/coverage; compiled kernels are not traced (pyproject.toml says more)
coverage: .venv/installed
	$(PYTEST) -m "not slow" --cov --cov-report=term --cov-report=html

# the equations run as Python, without numba: slow, so only the tests that need few steps
coverage-kernels: .venv/installed
	NUMBA_DISABLE_JIT=1 $(PYTEST) -m "not slow" --cov=cable_envs --cov-report=term tests/physics tests/effects/test_effects_drive.py tests/core

bench: .venv/installed
	$(BIN)/python -m benchmarks

# seven minutes: what every plant keeps over random rigs, as a page of the documentation
properties: .venv/installed
	$(BIN)/python -m benchmarks.properties --rigs 40 --out docs/properties.md

# half an hour: SIGKILL at 200 random moments of every command that writes, and what is left compared (tests/crashes)
kills: .venv/installed
	$(BIN)/python -m tests.crashes.kills --kills 200 --out results/kills.jsonl

# hours: every effect 20 times on every system
proof: .venv/installed
	$(BIN)/cablebench blind-test --out results/proof --jobs $(JOBS)

proof-quick: .venv/installed
	$(BIN)/cablebench blind-test --quick --no-baselines --out $(PROOF) --jobs $(JOBS)

# the public recordings are not part of the project: ../shared/recordings/README.md says where they are from
recordings: .venv/installed
	$(BIN)/cablebench real-data --out docs/recordings

# the site, into build/site: strict, a link that leads nowhere is an error. The papers are computed again if their code
# has changed (minutes); what else takes long is kept in build/site-cache
docs: .venv/installed build/reproduction/index.html
	$(BIN)/python -m mkdocs build --strict

docs-serve: .venv/installed
	$(BIN)/python -m mkdocs serve

build/reproduction/index.html: $(shell find -L cable_envs/physics cable_envs/plants reproduction configs -name '*.py' -o -name '*.yaml' -o -name '*.j2')
	$(BIN)/cablebench reproduce --out build/reproduction --jobs $(JOBS)

lint: .venv/installed
	$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy

# with the kernels of the shipped plants, compiled ahead for this Python, numba, llvmlite and platform; with others the
# same wheel compiles them (CONTRIBUTING.md)
wheel: .venv/installed
	rm -rf build/kernels
	$(BIN)/python -m cable_envs.shipped build/kernels
	CABLE_ENVS_KERNELS=build/kernels $(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist .

clean:
	rm -rf .venv build dist

# --no-compile: Python writes bytecode when a module is first imported; for all of torch and SciPy it takes a minute
.venv/installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e '.[dev]'
	touch $@
