# make live [SOURCE=/dev/video0 | video.avi | folder | http://… | rtsp://…]   see force, live
# make live SENSOR=mine.yaml [SOURCE=…] [MODEL=…]                             of a described sensor (docs/sensors.md)
# make test                                                                   run the tests
# make oldest                                                                 run them with the oldest versions that setup.py allows
# make documents                                                              run the commands of the documents, the long ones too
# make site                                                                   build the documentation as a searchable site
# make fuzz                                                                   run the random ones with other examples, until Ctrl-C
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
SOURCE ?= simulated
SENSOR ?=
MODEL ?=
ARGS ?=
# One more than there are processors, since many tests wait, and not more than four. With two for each processor, tests of
# devices in real time were kept waiting too long.
WORKERS ?= $(shell $(PYTHON) -c 'import os; print(min(4, 1 + (os.cpu_count() or 1)))')
PIP := $(BIN)/python -m pip install --quiet --quiet --disable-pip-version-check

.PHONY: live test oldest fuzz documents lint docs site site-serve clean

# Of a described sensor, without a model of it, that which follows from the description; it takes some seconds.
OWN_MODEL := build/live/$(notdir $(basename $(SENSOR))).safetensors
live: $(VENV)/.live
ifneq ($(SENSOR),)
ifeq ($(MODEL),)
	@mkdir -p $(dir $(OWN_MODEL))
	@$(BIN)/tactile calibrate --sensor '$(SENSOR)' --model field -o '$(OWN_MODEL)'
endif
endif
	@exec $(BIN)/tactile launch live --view source:='$(SOURCE)' $(if $(SENSOR),sensor:='$(SENSOR)') \
	  $(if $(MODEL)$(SENSOR),model:='$(or $(MODEL),$(OWN_MODEL))') $(ARGS)

test: $(VENV)/.dev
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses $(WORKERS) --dist worksteal $(ARGS)

# What another program pins may be older than what pip would choose: ROS 2 Jazzy needs numpy 1.26, and so OpenCV 4.11.
oldest:
	@test -e build/oldest/bin/python || $(PYTHON) -m venv build/oldest
	build/oldest/bin/python -m pip install --quiet --constraint constraints.txt torch uv
	build/oldest/bin/uv pip install --python build/oldest --resolution lowest-direct --editable '.[train,dev]'
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 \
	  build/oldest/bin/python -m pytest --numprocesses $(WORKERS) --dist worksteal $(ARGS)

# The random tests, again and again with other examples until Ctrl-C or a failure; SEED=… tries those of that seed again.
# What fails is kept in .hypothesis/found, and tried first in the next round.
fuzz: $(VENV)/.dev
	@for round in $$(seq $(if $(SEED),1,1000000)); do \
	  seed=$(or $(SEED),$$(od -An -N4 -tu4 /dev/urandom | tr -d ' ')); \
	  echo "round $$round: make fuzz SEED=$$seed"; \
	  TACTILE_HYPOTHESIS=fuzz TACTILE_SEED=$$seed OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 \
	    $(BIN)/python -m pytest -q -m hypothesis --numprocesses $(WORKERS) --dist loadfile $(ARGS) || exit 1; \
	done

# Every command of README and the how-to pages that needs no device, the long ones too.
documents: $(VENV)/.dev
	TACTILE_LONG=1 $(BIN)/python -m pytest -q --timeout 3600 test/documents $(ARGS)

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 10) else "Python 3.10 or newer is needed; choose one with: make PYTHON=python3.11 …")'
	@echo 'Making a virtual environment in $(VENV) …'
	@$(PYTHON) -m venv $(VENV)

# Without torch: nothing in the live path needs it. Python compiles what is imported; of numba and scipy that is little,
# and the first force comes seconds earlier than if pip compiled all of it.
$(VENV)/.live: setup.py constraints.txt | $(BIN)/python
	@echo 'Installing what live sensing needs (about 650 MB on disk, no torch) …'
	@$(PIP) --no-compile --constraint constraints.txt --editable .
	@touch $@

# torch first and by its exact version, so that nothing else chooses another build of it. Beside that the inner loops are
# compiled, which tests wait for otherwise.
$(VENV)/.dev: setup.py constraints.txt $(VENV)/.live
	@echo 'Installing what training and the tests need …'
	@nice $(BIN)/tactile compile >/dev/null & \
	$(PIP) --constraint constraints.txt torch && $(PIP) --constraint constraints.txt --editable '.[train,dev]' && wait
	@touch $@

$(VENV)/.docs: setup.py constraints.txt $(VENV)/.live
	@echo 'Installing what the site of the documentation needs …'
	@$(PIP) --constraint constraints.txt --editable '.[docs]'
	@touch $@

docs: $(VENV)/.live
	$(BIN)/tactile reference

# build/site, from docs/ and the docstrings; a link that leads nowhere is an error. (With --quiet it would be none.)
site: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo 'build/site/index.html'

# The same, for this machine alone, built anew whenever a page changes.
site-serve: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs serve --strict --dev-addr 127.0.0.1:8000

clean:
	rm -rf $(VENV) build *.egg-info
