# Every command of this project. `make quickstart` and `make test` need Python and make, nothing else.
#
#   make quickstart              a dataset, two algorithms, a table, curves and an animation, in quickstart/
#   make test                    the default tests; PYTHON=python3.12 runs them on another Python, with its newest
#                                packages; PACKAGES=newest and PACKAGES=lowest choose, see below
#   make matrix                  tests with the newest packages, the lowest and the core only, and the site; a table
#   make core                    the commands that need no extra, in a new environment without extras
#   make check                   format, lint, types, layers, spelling (make fix repairs the first two)
#   make slow | learns           the long tests; tests that train until a threshold is beaten
#   make docs | notebooks        the site, into dist/docs; the notebooks of the tutorials, which takes minutes
#   make bench | wheel           the timings, into docs/measurements.md; the installable files, into dist/
#   make release                 the wheel, the source, their checksums and every mini as a folder for a hub, in dist/
#   make digests                 builds every mini under many circumstances, compares digests; takes hours
#   make clean                   removes what the targets made, except datasets in the user cache

PYTHON ?= python3
ARGS ?=

VERSION := $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])')
ifeq ($(VERSION),)
$(error $(PYTHON) does not run; name a Python from 3.11 on, as in: make test PYTHON=python3.12)
endif

# PACKAGES: pinned (constraints.txt, for Python 3.11), newest (of the registry), or lowest (the bounds in
# pyproject.toml). TORCH: the requirement of torch to test with, such as torch==2.13.0; empty: none, and its
# tests skip. Elsewhere than with constraints.txt it is empty unless given: the registry's torch is several GB.
USUAL := $(if $(filter 3.11,$(VERSION)),pinned,newest)
PACKAGES ?= $(USUAL)
TORCH ?= $(if $(filter pinned,$(PACKAGES)),torch)
CONSTRAINT_OF_pinned = --constraint constraints.txt
CONSTRAINT_OF_lowest = --constraint $(VENV)/lowest.txt

# The default Python lives in .venv, any other in a folder of its own.
VENV ?= .venv$(if $(filter python3,$(PYTHON)),,-$(VERSION))$(if $(filter $(USUAL),$(PACKAGES)),,-$(PACKAGES))
BIN := $(VENV)/bin
STAMPS := $(VENV)/.stamps
PACK := swarmdata/runtime/kernel_pack_files

LOWEST := $(if $(filter lowest,$(PACKAGES)),$(VENV)/lowest.txt)
BOUNDED := $(if $(TORCH),torch) plots parquet s3 mujoco
COMPILE = $(BIN)/uv pip compile --quiet --python-version $(VERSION) pyproject.toml $(BOUNDED:%=--extra %)

comma := ,
TEST_EXTRAS := $(if $(TORCH),torch$(comma))plots

# uv installs several times as fast as pip. Only torch comes with pip, whose settings may name an index or a
# folder of builds for the CPU; uv does not read them.
UV = $(BIN)/uv pip install --quiet --python $(BIN)/python
INSTALL = $(UV) $(CONSTRAINT_OF_$(PACKAGES))
# With one version on all Pythons, so that findings do not change by the day.
TOOLS = $(UV) --constraint constraints.txt

QUICK_DATA = coop_nav-medium-replay-mini

.PHONY: quickstart clips test core matrix check fix slow learns docs notebooks bench digests wheel release clean
.DELETE_ON_ERROR:

$(STAMPS)/venv:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet uv
	mkdir -p $(STAMPS) && touch $@

# The lowest versions that the package and its extras accept, then the newest test tools that go with them.
$(VENV)/lowest.txt: pyproject.toml | $(STAMPS)/venv
	echo '$(TORCH)' | $(COMPILE) --resolution lowest-direct --output-file $@.bounds -
	echo '$(TORCH)' | $(COMPILE) --group test --constraint $@.bounds --output-file $@ -

$(STAMPS)/torch: constraints.txt $(LOWEST) | $(STAMPS)/venv
	$(BIN)/python -m pip install --quiet $(CONSTRAINT_OF_$(PACKAGES)) $(or $(TORCH),torch)
	touch $@

$(STAMPS)/package: pyproject.toml constraints.txt $(STAMPS)/torch
	$(INSTALL) --editable '.[torch,plots]'
	touch $@

$(STAMPS)/test: pyproject.toml constraints.txt $(LOWEST) $(if $(TORCH),$(STAMPS)/torch) | $(STAMPS)/venv
	$(INSTALL) --editable '.[$(TEST_EXTRAS)]' --group test $(TORCH)
	touch $@

$(STAMPS)/slow: $(STAMPS)/test
	$(INSTALL) --group interop
	touch $@

$(STAMPS)/lint: $(STAMPS)/test
	$(TOOLS) --group lint
	touch $@

$(STAMPS)/docs: $(STAMPS)/test
	$(TOOLS) --group docs
	touch $@

# what the tutorials ask their readers to install
$(STAMPS)/notebooks: $(STAMPS)/docs
	$(INSTALL) --editable '.[torch,plots,logs,onnx]'
	touch $@

quickstart: $(STAMPS)/package
	$(BIN)/swarmdata generate $(QUICK_DATA)
	$(MAKE) -j 2 quickstart-bc quickstart-maddpg_bc
	$(BIN)/swarmdata evaluate random expert quickstart/bc quickstart/maddpg_bc --workers 2 --out quickstart/results
	$(BIN)/swarmdata report quickstart/results quickstart/bc quickstart/maddpg_bc --out quickstart/report
	$(BIN)/swarmdata render quickstart/maddpg_bc --out quickstart/episode.gif

# one core each
quickstart-%:
	$(BIN)/swarmdata train $* $(QUICK_DATA) --seeds 3 --updates 1500 --curve-every 500 --out quickstart/$*

clips: $(STAMPS)/package
	for task in coop_nav formation transport warehouse intersection search pursuit tag; do \
	  $(BIN)/swarmdata task play $$task --size 240 --out cards/worlds/$$task-scripted.gif; done
	$(BIN)/swarmdata task play coop_nav --observation lidar --communication lossy-30 --size 320 \
	  --out cards/worlds/coop_nav-lidar-lossy.gif

test: $(STAMPS)/test
	$(BIN)/python -m pytest -n 2 --dist loadfile $(ARGS)

core:
	rm -rf .venv-core
	$(PYTHON) -m venv .venv-core
	.venv-core/bin/python -m pip install --quiet .
	mkdir .venv-core/scratch
	.venv-core/bin/python tests/support/core_commands.py .venv-core/scratch --long

matrix:
	$(PYTHON) -m tests.support.version_matrix $(ARGS)

check: $(STAMPS)/lint
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/codespell $$(git ls-files '*.py' '*.md' '*.toml' Makefile)

fix: $(STAMPS)/lint
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

slow: $(STAMPS)/slow
	@PATH=$$PATH:/usr/sbin command -v nginx >/dev/null || echo 'nginx is absent, so its tests are skipped; on Debian: apt-get install nginx-light'
	$(BIN)/python -m pytest -m 'slow and not learns and not gpu' $(ARGS)

learns: $(STAMPS)/test
	$(BIN)/python -m pytest -m 'learns and not gpu' $(ARGS)

docs: $(STAMPS)/docs
	$(BIN)/python -m docs.site.build_site --out dist/docs $(ARGS)

notebooks: $(STAMPS)/notebooks
	$(BIN)/python -m docs.site.make_notebooks $(ARGS)

bench: $(STAMPS)/test
	set -e; for file in $(filter-out %/bench_digests.py,$(wildcard tests/benchmarks/bench_*.py)); do \
	echo "== $$file"; $(BIN)/python -m tests.benchmarks.$$(basename $$file .py); done

digests: $(STAMPS)/test
	$(BIN)/python -m tests.benchmarks.bench_digests $(ARGS)

# The wheel has compiled kernels inside, for x86-64 and this Python and numba: see building/kernel_pack.py.
# Elsewhere they are compiled at first use, as in a checkout.
wheel: $(STAMPS)/test
	rm -rf $(PACK) build
	test "$$(uname -m)" != x86_64 || { \
	  export NUMBA_CPU_NAME=x86-64-v3 NUMBA_CPU_FEATURES= NUMBA_CACHE_DIR=$(CURDIR)/build/kernels; \
	  $(BIN)/swarmdata warm && $(BIN)/python -m swarmdata.building.kernel_pack $(PACK); }
	$(BIN)/python -m hatchling build --target wheel --target sdist --directory dist
	rm -rf $(PACK) build

# Built anew, so that cards are those of this version; CONTRIBUTING.md says what comes then.
MINIS = $(patsubst cards/published/%.md,%,$(wildcard cards/published/*-mini-v*.md))
HUB = $(CURDIR)/dist/hub

release: wheel $(MINIS:%=$(HUB)/%/manifest.json)
	cd dist && sha256sum *.whl *.tar.gz > SHA256SUMS

$(HUB)/%/manifest.json:
	mkdir -p $(HUB)
	$(BIN)/swarmdata generate $* --out dist/minis/$*
	$(BIN)/swarmdata push dist/minis/$* file://$(HUB)
	rm -r dist/minis/$*

clean:
	rm -rf .venv .venv-* dist quickstart .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
