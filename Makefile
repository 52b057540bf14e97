# make demo    set everything up, then show the embedded sample: in a window where there is a display, else as files in demo-out/
# make test    set everything up, then run every test and check, under a virtual display
# make test-cuda    set everything up, then run the tests that need a GPU; fails where there is none
# make demo-scene    make the embedded sample anew (two minutes)
# make docs    set everything up, then write all of docs as web pages into build/docs
# make audit    ask for known faults of the pinned versions (pip-audit; takes the network); fails where a version could not be asked about
# make lint    the checks of the project itself only: formatting, lint, types, structure, documents, the wheel
#
# PYTHON=python3.12       another interpreter for .venv
# TESTS='tests/field'     some of the tests only: what pytest is told, e.g. TESTS='-m real_clips'
# AUDIT=osv               another source of known faults for `make audit`: pypi, osv or esms
# TORCH_INDEX=URL         one more package index, e.g. https://download.pytorch.org/whl/cpu for a PyTorch without CUDA

PYTHON ?= python3
TESTS ?=
AUDIT ?= pypi
TORCH_INDEX ?=
export PYTHON

VENV := .venv/bin
DISPLAY_KIND := $(if $(DISPLAY)$(WAYLAND_DISPLAY),window,headless)

.NOTPARALLEL:
.PHONY: demo test test-cuda lint docs audit demo-scene system-headless system-window system-test

demo: system-$(DISPLAY_KIND) .venv/installed
	$(VENV)/degense demo $(if $(filter headless,$(DISPLAY_KIND)),--headless demo-out)

test: system-test .venv/installed
	env -u WAYLAND_DISPLAY QT_QPA_PLATFORM=xcb xvfb-run -a -s '-screen 0 1600x1000x24' $(VENV)/python -m pytest -n 3 --durations=10 $(TESTS)

test-cuda: system-headless .venv/installed
	$(VENV)/python -c "import torch; torch.cuda.current_device()"
	$(VENV)/python -m pytest -m cuda $(TESTS)

lint: system-headless .venv/installed
	$(VENV)/python -m pytest -q tests/house

docs: system-headless .venv/installed
	$(VENV)/mkdocs build --strict

audit: .venv/installed
	$(VENV)/python -m pip install --disable-pip-version-check -c constraints.txt -q 'pip-audit>=2.9'
	$(VENV)/pip-audit --strict -s $(AUDIT) -r constraints.txt --no-deps --disable-pip

demo-scene: .venv/installed
	$(VENV)/python scripts/demo-scene

system-headless system-window system-test: system-%:
	@scripts/system-packages $*

.venv/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(VENV)/python -m pip install --disable-pip-version-check -c constraints.txt $(if $(TORCH_INDEX),--extra-index-url $(TORCH_INDEX)) -e '.[dev]'
	$(VENV)/python -m compileall -q app engine widgets
	$(VENV)/python -m degense.app.warm_up
	touch $@
