# make serve   install everything into .venv and start Mary on http://localhost:8080
# make test    install what the tests need and run them
#
# PY=python3.12 make serve     another Python (3.11 or newer)
# make test ARGS="-k config"   further arguments for pytest, mary serve or the bench

PY   ?= python3
ARGS ?=
VENV := .venv
BIN  := $(VENV)/bin
PIP  := $(BIN)/python -m pip --disable-pip-version-check --quiet

.DEFAULT_GOAL := help
.PHONY: help install install-dev serve test bench lint format lock clean

help:  ## this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-12s %s\n", $$1, $$2}'

install: $(VENV)/.installed  ## the virtual environment in .venv with everything that running needs

install-dev: $(VENV)/.installed-dev  ## and what tests, lint and types need

serve: install  ## start the service (settings: config.yaml, MARY_SECTION__KEY)
	@exec $(BIN)/mary serve $(ARGS)

test: install-dev  ## all tests (the browser tests use Debian's chromium)
	$(BIN)/python -m pytest $(ARGS)

bench: install-dev  ## the measurements, each with its baseline
	$(BIN)/python -m bench $(ARGS)

lint: install-dev  ## ruff (rules and format) and mypy --strict
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --strict app

format: install-dev  ## let ruff write the format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

lock: install  ## resolve pyproject.toml anew into the two lock files
	$(PIP) install pip-tools
	CUSTOM_COMPILE_COMMAND="make lock" $(BIN)/pip-compile $(LOCK_FLAGS) --output-file requirements.lock pyproject.toml
	CUSTOM_COMPILE_COMMAND="make lock" $(BIN)/pip-compile $(LOCK_FLAGS) --extra test --extra lint \
		--constraint requirements.lock --output-file requirements-dev.lock pyproject.toml

# --upgrade: newest versions that pyproject.toml allows. Names and versions only: no index, host or path is written.
LOCK_FLAGS := --quiet --upgrade --strip-extras --no-config --no-emit-index-url --no-emit-trusted-host --no-emit-find-links

clean:  ## remove the virtual environment and all caches
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(BIN)/python:
	@command -v $(PY) >/dev/null || { \
		echo "No $(PY) here. Debian and Ubuntu: sudo apt-get install python3 python3-venv"; exit 1; }
	@$(PY) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "Mary needs Python 3.11 or newer; $(PY) is $$($(PY) -V 2>&1). Name another one: PY=python3.12 make install"; exit 1; }
	@$(PY) -c 'import venv, ensurepip' 2>/dev/null || { \
		echo "$(PY) cannot make virtual environments. Debian and Ubuntu: sudo apt-get install python3-venv"; exit 1; }
	$(PY) -m venv $(VENV)

# The stamps make repeats instant: pip runs again only when a lock file or pyproject.toml has changed.
$(VENV)/.installed: requirements.lock pyproject.toml | $(BIN)/python
	@echo "Installing Mary into $(VENV) (a minute or two, once) ..."
	$(PIP) install --requirement requirements.lock
	$(PIP) install --no-deps --editable .
	@touch $@

$(VENV)/.installed-dev: requirements-dev.lock $(VENV)/.installed
	@echo "Installing what the tests need into $(VENV) ..."
	$(PIP) install --requirement requirements-dev.lock
	@touch $@
