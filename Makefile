PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
INSTALLED := .venv/.installed
BARE := .venv-bare/.installed

.PHONY: install bare demo test test-versions lint format extension bench clean

install: $(INSTALLED)

# One pip command for bpy and opencv: resolved apart, opencv pulls in a numpy that bpy cannot use.
$(INSTALLED): pyproject.toml setup.py
	@$(PYTHON) tools/check_libraries.py
	@$(call make_venv,.venv)
	$(BIN)/python -m pip install --quiet --editable '.[blender,dev]'
	@$(BIN)/python tools/check_libraries.py --import-bpy
	@touch $@

# An environment with Blender alone: an extension that works here brings all of its own wheels.
bare: $(BARE)

$(BARE): pyproject.toml
	@$(PYTHON) tools/check_libraries.py
	@$(call make_venv,.venv-bare)
	.venv-bare/bin/python -m pip install --quiet $$(sed -n 's/^blender = \["\(.*\)"\]/\1/p' pyproject.toml)
	@touch $@

# Debian's Python has no ensurepip before python3-venv is installed, but it may have a pip to lend.
define make_venv
if [ ! -x $(1)/bin/pip ]; then \
	if $(PYTHON) -c 'import ensurepip' 2>/dev/null; then $(PYTHON) -m venv $(1); \
	else $(PYTHON) -m venv --without-pip $(1) && $(PYTHON) -m pip --python $(1)/bin/python install --quiet pip; fi; \
fi
endef

demo: install
	$(BIN)/kfmocap demo --out build/demo

test: install
	$(BIN)/python -m pytest --numprocesses auto --dist loadfile

# The add-on's tests on the other versions of Blender, where their Python is there.
test-versions: install
	$(BIN)/python tools/test_versions.py

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	@mkdir -p build/typing && ln -sfn ../.. build/typing/kfmocap
	$(BIN)/mypy -p kfmocap.core -p kfmocap.cli

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
