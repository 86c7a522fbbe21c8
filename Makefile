# Needs Python 3.11 or later, pip and make. Another interpreter: make PYTHON=python3.12 test
PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin/python -m
INSTALLED := $(VENV)/.installed
SAMPLE := patterns/snapshots/sample/grains_biaxial.csv.gz
SLOW := patterns/snapshots/sample/slow
OUT := demo-output
SITE := docs-output

ROOMS := grainloops loops patterns stability studies

.PHONY: demo test prose slow docs lint types format clean

demo: $(INSTALLED)
	@echo "1 of 3: the loops of a snapshot of 600 grains"
	$(VENV)/bin/grainloops snapshot $(SAMPLE) --out $(OUT)/snapshot --force
	@echo
	@echo "2 of 3: a series of four snapshots of 2000 grains, predicted by its packings"
	$(VENV)/bin/grainloops series $(SLOW)/grains_*.parquet --cells $(SLOW)/cells.csv --shear-increment radii --in-packing --out $(OUT)/series --force
	@echo
	@echo "3 of 3: the two tables of Nicot et al. (2016)"
	$(VENV)/bin/grainloops diamond --table 1 --out $(OUT)/diamond-table1 --force
	$(VENV)/bin/grainloops diamond --table 2 --out $(OUT)/diamond-table2 --force
	@echo
	@echo "Open these pages in a browser; figures and tables stand beside them:"
	@echo "  $(CURDIR)/$(OUT)/snapshot/report.html"
	@echo "  $(CURDIR)/$(OUT)/series/report.html"
	@echo "The paper's Tables 1 and 2 (states I, A, B above), as figures:"
	@echo "  $(CURDIR)/$(OUT)/diamond-table1, $(CURDIR)/$(OUT)/diamond-table2"
	@echo "Then a snapshot of your own:"
	@echo "  . $(VENV)/bin/activate"
	@echo "  grainloops snapshot grains_05.csv     # contacts_05.csv stands beside it"

# One thread of BLAS for each of the two processes, neighbouring tests in one of them; bytecode and
# compiled kernels are kept beside the sources.
TEST := OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= $(RUN) pytest -n 2 --dist worksteal

# The code.
test: $(INSTALLED)
	$(TEST) tests --ignore=tests/docs --ignore=tests/golden --ignore=tests/test_wheel.py

# What pages, docstrings and stored answers say: tests of docs, golden files, doctests; and the
# package: sdist and wheel are built and installed under each Python of .ci/pythons that is there.
prose: $(INSTALLED)
	$(TEST) tests/docs tests/golden tests/test_wheel.py $(ROOMS)

# What both leave out, with the time that each took; three quarters of an hour on two quiet cores.
slow: $(INSTALLED)
	@status=0; \
	$(TEST) --durations=0 -m "slow and not collection and not published" || status=1; \
	if [ -d "$$GRAINLOOPS_DEM" ]; then \
		$(TEST) --durations=0 -m collection || status=1; \
	else \
		echo "The tests on the collection of DEM snapshots did not run: GRAINLOOPS_DEM names no folder."; \
	fi; \
	if [ -d "$$GRAINLOOPS_PUBLISHED" ]; then \
		$(TEST) --durations=0 -m published || status=1; \
	else \
		echo "The tests on published systems did not run: GRAINLOOPS_PUBLISHED names no folder."; \
	fi; \
	exit $$status

docs: $(VENV)/.docs
	$(RUN) sphinx -q -W --keep-going -E -b html docs $(SITE)
	@echo "Open $(CURDIR)/$(SITE)/index.html in a browser."

lint: $(INSTALLED)
	$(RUN) ruff check .
	$(RUN) ruff format --check .

types: $(INSTALLED)
	$(RUN) mypy

format: $(INSTALLED)
	$(RUN) ruff format .
	$(RUN) ruff check --fix .

clean:
	rm -rf $(VENV) $(OUT) $(SITE) docs/gallery build dist *.egg-info .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find $(ROOMS) tests -name __pycache__ -type d -prune -exec rm -rf {} +

# Built afresh whenever the requirements change; an install that fails leaves no stamp.
# Some systems split ensurepip from Python: their own pip then fills the environment.
$(INSTALLED): pyproject.toml constraints.txt
	@command -v $(PYTHON) >/dev/null || { echo "$(PYTHON) not found: install Python 3.11 or later, or name yours: make PYTHON=/path/to/python3"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "$(PYTHON) is $$($(PYTHON) --version 2>&1), expected 3.11 or later. Name another: make PYTHON=python3.12"; exit 1; }
	@if $(PYTHON) -c 'import ensurepip, venv' 2>/dev/null; then \
		$(PYTHON) -m venv --clear $(VENV); \
	elif $(PYTHON) -c 'import pip, venv' 2>/dev/null; then \
		$(PYTHON) -m venv --clear --without-pip $(VENV) && $(PYTHON) -m pip --python $(VENV)/bin/python install --quiet pip; \
	else \
		echo "$(PYTHON) can make no virtual environment: venv, or both ensurepip and pip, are missing. On Debian and Ubuntu: apt install python3-venv"; exit 1; \
	fi
	@echo "Installing grainloops and its libraries into $(VENV): downloads of some 300 MB, several minutes the first time."
	$(RUN) pip install -c constraints.txt -e '.[test,lint]'
	@echo "Installed."
	@touch $@

$(VENV)/.docs: $(INSTALLED)
	@echo "Installing the libraries that build the documentation into $(VENV)."
	$(RUN) pip install -c constraints.txt -e '.[docs]'
	@touch $@
