# Each target installs what it needs into .venv; Python 3.11, git and make are enough.
PYTHON ?= python3.11
COMMAND ?= a person strides forward
VENV := .venv
BIN := $(VENV)/bin

# One thread per process: the arrays are small, and the tests already run in parallel.
export OMP_NUM_THREADS ?= 1

# The peer that the controller is measured beside needs another Pinocchio.
TSID := .venv-tsid

.PHONY: help demo test test-packaging bench lint format clean
.NOTPARALLEL:
.DEFAULT_GOAL := help

help:
	@echo "make demo            a command that the robot would fall with, and what it does instead"
	@echo "                     (COMMAND='a person bows deeply' for another one)"
	@echo "make test            run the tests"
	@echo "make test-packaging  build sdist and wheel and try them in a fresh environment"
	@echo "make bench           measure retargeter, controller and adaptation"
	@echo "make lint            ruff and mypy"
	@echo "make format          let ruff format and fix the sources"

define install
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable "$(1)"
	touch $@
endef

$(VENV)/.run: pyproject.toml constraints.txt
	$(call install,.)

$(VENV)/.dev: pyproject.toml constraints.txt
	$(call install,.[dev])

$(VENV)/.bench: pyproject.toml constraints.txt
	$(call install,.[bench])

demo: $(VENV)/.run
	$(BIN)/robomirror run "$(COMMAND)" --out results/demo

test: $(VENV)/.dev
	$(BIN)/pytest -n 2 --dist loadfile -m "not packaging"

test-packaging: $(VENV)/.dev
	$(BIN)/pytest -m packaging

$(TSID)/.ready: requirements-tsid.txt
	test -x $(TSID)/bin/python || $(PYTHON) -m venv $(TSID)
	$(TSID)/bin/python -m pip install --quiet --only-binary :all: --requirement requirements-tsid.txt
	touch $@

bench: $(VENV)/.bench
	-$(MAKE) --no-print-directory $(TSID)/.ready  # without it the peer is left out
	$(BIN)/robomirror bench retarget
	$(BIN)/robomirror bench controller
	$(BIN)/robomirror bench adaptation

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/.dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .coverage
