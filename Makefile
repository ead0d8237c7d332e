# Everything a user or CI runs. Each target sets the environment up first, once.

SHELL := /bin/bash
PYTHON ?= python3
ARGS ?=

BIN := .venv/bin
# A virtual environment made beside a sourced ROS 2 is another one than one made from wheels.
READY := .venv/.ready-$(or $(ROS_DISTRO),wheels)
SETUP_FILES := scripts/setup.sh $(wildcard requirements*.txt src/*/setup.py src/*/setup.cfg src/*/package.xml)

.DEFAULT_GOAL := help

help: ## Show these lines.
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-15s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

$(READY): $(SETUP_FILES)
	@PYTHON='$(PYTHON)' scripts/setup.sh '$@'

setup: $(READY) ## Make .venv and install everything in it; a second run installs nothing.

demo: $(READY) ## Watch a robot find its way out of a maze; ARGS="--size 30 --seed 7" and the like vary it.
	@$(BIN)/vgdp demo $(ARGS)

demo-seeds: $(READY) ## Run the demo for the seeds 0 to 19 and print a table; ARGS as above.
	@scripts/demo_seeds.sh $(ARGS)

demo-home: $(READY) ## Watch a robot with a camera find a bottle in a home; ARGS="--seed 7" and the like vary it.
	@$(BIN)/vgdp demo-home $(ARGS)

demo-home-seeds: $(READY) ## Run that demo for the seeds 0 to 19 and print a table; ARGS as above.
	@DEMO=demo-home scripts/demo_seeds.sh $(ARGS)

# A sourced ROS 2 brings pytest plugins of its own, made for another pytest. Small networks on many
# threads only get in the way of the nodes that run beside them.
test: lint ## Lint and run the tests; ARGS go to pytest.
	@PYTEST_DISABLE_PLUGIN_AUTOLOAD=1 OMP_NUM_THREADS=1 $(BIN)/python -m pytest $(ARGS)

lint: $(READY) ## Check style, format and types.
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check
	@$(if $(ROS_DISTRO),echo 'mypy is left out: its findings differ with the NumPy 1 of ROS 2 $(ROS_DISTRO).',$(BIN)/mypy)

workspace: $(READY) ## Build ros2_ws with colcon.
	@scripts/build_workspace.sh ros2_ws

bench: $(READY) ## Measure the simulator and the planner.
	@$(BIN)/vgdp bench sim
	@$(BIN)/vgdp bench planner

tables: $(READY) ## Write the tables, the result pages and the parameter file anew from the code.
	@$(BIN)/python scripts/write_readme.py
	@$(BIN)/python scripts/write_config.py
	@$(BIN)/python scripts/write_results.py

clean: ## Remove what the other targets made, the virtual environment too.
	rm -rf .venv out ros2_ws/build ros2_ws/install ros2_ws/log .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find src -name '*.egg-info' -prune -exec rm -rf {} +

.PHONY: help setup demo demo-seeds demo-home demo-home-seeds test lint workspace bench tables clean
