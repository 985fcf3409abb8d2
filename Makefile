PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
INSTALLED := .venv/.installed
WHEELS := .venv/.wheels

# Without compiled modules on disk, each process would compile all of the package anew: 0.2 seconds.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help install demo test test-nightly test-versions versions lint format extension bench clean

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1\t/' | expand -t 16

install: $(INSTALLED)  ## make the environment .venv with everything in it

# One pip command for bpy and opencv: resolved apart, opencv pulls in a numpy that bpy cannot use.
$(INSTALLED): pyproject.toml setup.py
	@$(PYTHON) tools/check_libraries.py
	@$(call make_venv,.venv)
	$(BIN)/python -m pip install --quiet --editable '.[blender,dev]'
	@$(BIN)/python tools/check_libraries.py --import-bpy
	@$(BIN)/python -m compileall -q cli core kfmocap_addon benchmarks *.py
	@touch $@

# Debian's Python has no ensurepip before python3-venv is installed, but it may have a pip to lend.
define make_venv
if [ ! -x $(1)/bin/pip ]; then \
	if $(PYTHON) -c 'import ensurepip' 2>/dev/null; then $(PYTHON) -m venv $(1); \
	else $(PYTHON) -m venv --without-pip $(1) && $(PYTHON) -m pip --python $(1)/bin/python install --quiet pip; fi; \
fi
endef

# The wheels that the extension brings, so that no test downloads anything.
$(WHEELS): tools/wheels.lock | install
	$(BIN)/python tools/build_extension.py --fetch
	@touch $@

demo: install  ## track the example with real footage, into build/demo
	$(BIN)/kfmocap demo --out build/demo

# One test process per core.
PYTEST := $(BIN)/python -m pytest --numprocesses auto --dist worksteal --durations 25

test: install $(WHEELS)  ## run the tests
	$(PYTEST)

# The same with random tests at their full size, and a thousand damaged files of every kind.
test-nightly: install $(WHEELS)  ## run the tests, those with random values at their full size
	$(PYTEST) --nightly --damaged 1000

# What depends on the version of Blender, on the other versions, where their Python is there.
test-versions: install $(WHEELS)  ## run the add-on's tests on the other versions of Blender
	$(BIN)/python tools/test_versions.py

# The environments for that, without running anything.
versions: install  ## make the environments of these versions
	$(BIN)/python tools/test_versions.py --install

lint: install  ## check style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	@mkdir -p build/typing && ln -sfn ../.. build/typing/kfmocap
	@$(BIN)/python tools/make_stubs.py build/stubs
	$(BIN)/mypy

format: install  ## put the code into its format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

extension: install  ## write the zips for Blender, into dist
	$(BIN)/python tools/build_extension.py

bench: install  ## measure accuracy and speed
	$(BIN)/kfmocap bench

clean:  ## remove what was built
	rm -rf build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis *.egg-info
	find . -name __pycache__ -not -path './.venv*' -prune -exec rm -rf {} +
