# Needs Python 3.10 or newer with venv; .ci/environment installs the rest into .venv.
PYTHON ?= python3
BIN := .venv/bin
DISTRO := $(or $(ROS_DISTRO),wheels)
LOCKED := bags fleet report speed ros
PYTEST := $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

export OPENBLAS_NUM_THREADS := 1
# The ROS wheels re-execute Python once; the guard of another environment would stop that.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
# The tests start a hundred processes, which would compile every module anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help demo test coverage lint bank attack bench figures docs lock sbom faults fleet soak clean
.DEFAULT_GOAL := help

help:  ## list the targets
	@sed -n 's/^\([a-z]*\):.*## /\1\t/p' $(MAKEFILE_LIST) | expand -t 10

demo: .venv/.$(DISTRO)-run  ## the paper's experiment in closed loop over ROS 2 topics
	$(BIN)/flex_demo

test: .venv/.$(DISTRO)-test  ## all tests, style and types included
	$(PYTEST)

coverage: .venv/.$(DISTRO)-test  ## which lines the tests run; a fifth slower
	$(PYTEST) --cov --cov-report=term:skip-covered

lint: .venv/.$(DISTRO)-test  ## style and types alone
	$(BIN)/python -m pytest -q test/test_style.py

bank: .venv/.$(DISTRO)-bench  ## the bank of hidden effects from two simulators (docs/bank.md)
	$(BIN)/python test/run_bank.py

attack: .venv/.$(DISTRO)-test  ## mutated logs, bags and robot files by the thousand
	@set -e; for plan in 'csv 10000' 'bag 5000' 'robot 5000'; do \
	  PYTHONPATH=test $(BIN)/python -m attack.run $$plan --seed 1; done

bench: .venv/.$(DISTRO)-bench  ## every benchmark script
	@set -e; for script in benchmarks/[a-z]*.py; do echo "== $$script"; $(BIN)/python $$script; done

figures: .venv/.$(DISTRO)-run  ## Figures 13, 14, 15 and 18 of the paper
	$(BIN)/flex_figures

docs: .venv/.$(DISTRO)-test  ## the documentation as a site, in build/docs
	$(BIN)/python -m sphinx -b html -W --keep-going -q docs build/docs

lock: .venv/.$(DISTRO)-test  ## pin every dependency anew, with hashes
	$(BIN)/python -m pip install -q uv
	for kind in run test; do $(BIN)/uv -q pip compile setup.py --upgrade --universal --generate-hashes \
	  --no-strip-extras --python-version 3.10 --no-annotate --no-header -o requirements/$$kind.txt \
	  $$(test $$kind = run || echo --extra test) $(foreach extra,$(LOCKED),--extra $(extra)); done

sbom: .venv/.$(DISTRO)-test  ## software bill of materials of what make demo installs, as sbom.json
	$(BIN)/cyclonedx-py requirements -o sbom.json requirements/run.txt

FAULTS := PYTHONPATH=.:test $(BIN)/python test/faults

faults: .venv/.$(DISTRO)-test  ## faults between processes, bad samples, messages, logs, signals
	$(FAULTS)/processes.py --times 10 --page
	$(FAULTS)/bad_sample_run.py --page
	$(FAULTS)/sensor_run.py --page
	$(FAULTS)/mutated_messages.py --page
	$(FAULTS)/disturbed_logs.py --page
	$(FAULTS)/start_signals.py --page
	$(FAULTS)/outputs_run.py --page

fleet: .venv/.$(DISTRO)-test  ## 64 logs on one worker, on two, and with one killed
	$(FAULTS)/fleet_run.py --page

soak: .venv/.$(DISTRO)-test  ## an hour in real time at 1 kHz, one in lock-step: memory, latency, loss
	$(FAULTS)/soak.py --minutes 120 --page --picture docs/figures/soak.png

clean:  ## remove the virtual environment and everything built
	rm -rf .venv build install log *.egg-info .coverage .mypy_cache .pytest_cache .ruff_cache

.venv/.$(DISTRO)-%: setup.py pyproject.toml .ci/environment requirements/run.txt requirements/test.txt
	@PYTHON='$(PYTHON)' .ci/environment $* $@
