PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
INSTALLED := .venv/.installed
WHEELS := .venv/.wheels

# Without compiled modules on disk, each process would compile all of the package anew: 0.2 seconds.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: install demo test test-nightly test-versions versions lint format extension bench clean

install: $(INSTALLED)

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

demo: install
	$(BIN)/kfmocap demo --out build/demo

# One test process per core.
PYTEST := $(BIN)/python -m pytest --numprocesses auto --dist worksteal --durations 25

test: install $(WHEELS)
	$(PYTEST)

# The same with random tests at their full size, and a thousand damaged files of every kind.
test-nightly: install $(WHEELS)
	$(PYTEST) --nightly --damaged 1000

# What depends on the version of Blender, on the other versions, where their Python is there.
test-versions: install $(WHEELS)
	$(BIN)/python tools/test_versions.py

# The environments for that, without running anything.
versions: install
	$(BIN)/python tools/test_versions.py --install

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	@mkdir -p build/typing && ln -sfn ../.. build/typing/kfmocap
	@$(BIN)/python tools/make_stubs.py build/stubs
	$(BIN)/mypy

format: install
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

extension: install
	$(BIN)/python tools/build_extension.py

bench: install
	$(BIN)/kfmocap bench

clean:
	rm -rf build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis *.egg-info
	find . -name __pycache__ -not -path './.venv*' -prune -exec rm -rf {} +
