# The manual. `make` alone lists what there is.
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3; do $$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo $$p; break; }; done)
# On Linux, PyPI's torch carries CUDA (2 GB). Without a GPU: make demo TORCH_INDEX=https://download.pytorch.org/whl/cpu
TORCH_INDEX ?=
PIP  = .venv/bin/pip --disable-pip-version-check -qq
BIN  = .venv/bin
INSTALLED = .venv/.installed

.PHONY: help install demo test check-slow fuzz check format hooks train bench lines clean
.DEFAULT_GOAL := help

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## */  make \1\t/' | expand -t 18

install: $(INSTALLED)  ## create .venv with scenectl and its tools in it
	@:

$(INSTALLED): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "scenectl needs Python 3.11 or newer on the PATH (or: make PYTHON=/path/to/python3.11)"; exit 1; }
	@.ci/system-libs
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@echo "Installing into .venv (a few minutes the first time)"
	@$(PIP) install $(if $(TORCH_INDEX),--index-url $(TORCH_INDEX)) -c constraints.txt torch
	@$(PIP) install -c constraints.txt -e '.[dev]'
	@$(BIN)/python -c 'import scenectl, torch'
	@touch $@

demo: install  ## a person walks through the living room; the picture is out/demo/preview.png
	@$(BIN)/scenectl run examples/tasks/walk_to_target.toml -o out/demo
	@echo "Look at out/demo/preview.png, or turn it around: $(BIN)/scenectl view out/demo"

test: install  ## run the tests, on two cores if there are (CORES=8 for more; each takes 1.5 GB of memory)
	@OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n logical --maxprocesses $(or $(CORES),2) --dist worksteal

check-slow: install  ## open exported files in Blender, Godot and the Khronos validator (downloads bpy 4.5, 400 MB, and gltf-validator, once)
	@test -x .venv-blender/bin/python || ! command -v python3.11 >/dev/null || { \
		python3.11 -m venv .venv-blender && \
		.venv-blender/bin/pip --disable-pip-version-check -qq install 'bpy==4.5.*' || rm -rf .venv-blender; }
	@test -d .node/node_modules || ! command -v npm >/dev/null || npm install --silent --prefix .node gltf-validator@2.0.0-dev.3.10
	@$(BIN)/python -m tests.slow

fuzz: install  ## break files of every kind and read them (N=10000 of them, from seed FIRST=2000 on)
	@$(BIN)/python -m tests.fuzz --number $(or $(N),10000) --first $(or $(FIRST),2000)

check: install  ## lint, format and types
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

format: install  ## rewrite the code the way `make check` wants it
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

hooks: install  ## run the same checks before every commit
	@$(BIN)/pre-commit install

train: install  ## train tokenizer, transformer and refiner (hours; resumes; DATA=folder, CONFIG=compact|paper)
	@$(BIN)/scenectl train all --data $(or $(DATA),../shared/data/motions) --config $(or $(CONFIG),compact) -o runs/$(or $(CONFIG),compact)

bench: install  ## walk through the bundled rooms and print what was reached and what was touched
	@$(BIN)/scenectl bench rooms --tasks $(or $(TASKS),10) --json out/bench_rooms.json

lines: install  ## count lines of code by room
	@$(BIN)/python tests/lines.py

clean:  ## remove results and caches, keep .venv
	rm -rf out .pytest_cache .mypy_cache .ruff_cache .hypothesis build *.egg-info
