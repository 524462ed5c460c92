# Everything needs only Python 3.11 or newer and make: the first target that is made sets up .venv.
#   make PYTHON=python3.12 test    takes another interpreter        make WORKERS=8 test    uses more cores
PYTHON ?= python3
WORKERS ?= 2

VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

# The matrices are small: more threads of the linear algebra only wait for each other.
export OPENBLAS_NUM_THREADS := 1

.DEFAULT_GOAL := help
.PHONY: help setup plan test lint format types units quick docs bench trust mutants clean

help: ## this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "make %-8s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: $(READY) ## the virtual environment with jaxplan and its tools in .venv

plan: $(READY) ## plan case 2 of the paper; figures and plan.json in out/
	$(BIN)/jaxplan plan case-2 -o out

test: lint types units ## every check, as continuous integration runs them

lint: $(READY) ## format, style and layers
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports --no-logo

format: $(READY) ## rewrite the sources in the house format
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

types: $(READY) ## type hints
	$(BIN)/mypy

units: $(READY) ## tests and notebooks; one file stays on one worker, which compiles its kernels once
	$(BIN)/pytest --numprocesses $(WORKERS) --dist loadfile --durations 10

quick: $(READY) ## the tests that are not slow, in eight minutes on two cores; all packages have some
	$(BIN)/pytest --numprocesses $(WORKERS) --dist loadfile -m 'not slow'

docs: $(READY) ## the manual as pages in build/docs
	$(BIN)/sphinx-build -q -W --keep-going docs build/docs
	@echo 'open build/docs/index.html'

bench: $(READY) ## measure speed, one script after the other; leave the machine alone meanwhile
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[basilisk,bench,openscvx]'
	@set -e; for script in bench/[a-z]*.py; do echo "== $$script"; $(BIN)/python "$$script"; done

trust: $(READY) ## count what is claimed: certificates, plans, studies and bad input by the thousand, in one table (hours)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dask]'
	@PYTHONPATH=tests $(BIN)/python -m trust $(TRUST)

mutants: $(READY) ## change the sources one operator at a time, and see whether the tests find it (hours)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[mutants]'
	@$(BIN)/python tests/trust_mutants.py

clean: ## remove all that was made, .venv too
	rm -rf $(VENV) out build dist docs/generated .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Made anew when the dependencies change, or the extras below. Debian splits venv from Python, hence the second question.
$(READY): pyproject.toml Makefile
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	    echo 'jaxplan needs Python 3.11 or newer, and $(PYTHON) is not: name one with make PYTHON=...' >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	    echo '$(PYTHON) cannot make virtual environments; on Debian: apt-get install python3-venv' >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,notebooks,spice,study,dask,orbit,oem,schedule,view,czml,docs]'
	@touch $@
