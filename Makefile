# Every target sets up what it needs first; a set-up that is complete takes a moment.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := build
.PHONY: build demo demo-loop demo-explore test check attack bench bags lint clean help

build: ## ROS 2 Jazzy, the Python packages, and both ROS packages under install/
	@scripts/setup.sh

demo: build ## a recorded bag through the real nodes to a map, under out/demo/
	@source env.sh && python scripts/demo.py

demo-loop: build ## a simulated robot maps a ramp, plans and drives back over it; out/closed_loop/
	@source env.sh && python studies/closed_loop.py

demo-explore: build ## a simulated robot explores a ramp and its surroundings; out/explored/
	@source env.sh && heightmap25d explore ramp --seed 1 -o out/explored

test: build ## all tests: 7 to 9 minutes on 2 cores
	@source env.sh && python -m pytest -n $$(( $$(nproc) + 1 )) --dist loadfile --no-loadscope-reorder test

check: build ## style, types and the quick tests: a minute; before each commit
	@source env.sh && ruff check && ruff format --check && mypy && \
	  python -m pytest -q -m "not slow" -n auto --dist loadfile --no-loadscope-reorder test

attack: build ## hostile input, kills, fuzzing and a soak, at length: hours; docs/reliability.md
	@source env.sh && pip install -qq --constraint .venv/pins.txt \
	  --requirement requirements/attack.txt && python test/attack/campaign.py

bench: build ## the measurements, also as out/bench.json
	@source env.sh && pip install -qq --constraint .venv/pins.txt \
	  --requirement requirements/bench.txt && python benchmarks/run.py

bags: build ## the recordings in bags/ anew, the same bytes
	@source env.sh && python scripts/record_bags.py

lint: build ## style and types
	@source env.sh && ruff check && ruff format --check && mypy

clean: ## removes everything that the other targets make
	rm -rf .venv build install log out

help: ## this list
	@sed -nE 's/^([a-z-]+):[^#]*## (.*)/\1\t\2/p' Makefile | expand -t 12
