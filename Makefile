# Two commands do all: `make study` runs the study, `make test` lints and tests. Both make .venv first.
CONFIG ?= config/config.yaml
CORES ?= 2
PYTHON ?= python3
STUDY ?= spmd
ENVIRONMENT := .venv/.installed
EXTRAS := .venv/.extras
SNAKEMAKE := snakemake --cores $(or $(CORES),2) --configfile $(patsubst %,'%',$(or $(CONFIG),config/config.yaml))
RULES := Snakefile workflow benchmarks/samplers/Snakefile benchmarks/samplers/vehicles.smk \
  benchmarks/worlds/Snakefile benchmarks/claims/Snakefile benchmarks/motorway/Snakefile
SAMPLERS := snakemake --snakefile benchmarks/samplers/Snakefile --cores $(CORES)
PUBLIC := python benchmarks/samplers/public.py benchmarks/results
VEHICLES := snakemake --snakefile benchmarks/samplers/vehicles.smk --cores $(CORES)
WORLDS := snakemake --snakefile benchmarks/worlds/Snakefile --cores $(CORES)
MOTORWAY := snakemake --snakefile benchmarks/motorway/Snakefile --cores $(CORES) $(if $(SETTINGS),--config settings=$(SETTINGS))
REPEATED := snakemake --snakefile benchmarks/claims/Snakefile --cores $(CORES)
CLAIMS ?=
# The sampler is installed from its folder, so it has no hash.
RESOLVE := uv pip compile pyproject.toml --universal --python-version 3.11 --generate-hashes --no-header --quiet \
  --no-emit-package fewruns
export PATH := $(CURDIR)/.venv/bin:$(PATH)

.PHONY: environment extras container study book article test test-slurm test-studies test-fewruns crate pages lint format report smoke benchmark-samplers \
  benchmark-public benchmark-recordings benchmark-vehicles world worlds claims lock clean help
.DEFAULT_GOAL := help

help: ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 20

$(ENVIRONMENT): environment.txt pyproject.toml fewruns/pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "error: Python 3.11 or later is needed, $$($(PYTHON) --version) was found; set PYTHON=/path/to/python3.11" >&2; exit 1; }
	$(PYTHON) -m venv --clear .venv
	.venv/bin/python -m pip install --quiet --require-hashes -r environment.txt
	.venv/bin/python -m pip install --quiet --no-deps --no-build-isolation --editable ./fewruns --editable .
	@touch $@

$(EXTRAS): $(ENVIRONMENT) tests/environment.txt
	python -m pip install --quiet --require-hashes -r tests/environment.txt
	@touch $@

environment: $(ENVIRONMENT) ## make the environment .venv and nothing else; then: source .venv/bin/activate

extras: $(EXTRAS) ## add to it what the study does not need: recordings, FMUs, OSI, clusters, crates, scenario files, simulators, tests

study: $(ENVIRONMENT) ## run the study: make study [CONFIG=my_study.yaml] [CORES=2]
	$(SNAKEMAKE)

book: $(ENVIRONMENT) ## the book, and the results that it needs: results/<study>/book/index.html
	$(SNAKEMAKE) -- book

article: $(ENVIRONMENT) ## an article about the study, with all numbers and figures from its results: results/<study>/article.pdf
	$(SNAKEMAKE) -- article

report: study ## run the study, then write its self-contained HTML report to results/report.html
	$(SNAKEMAKE) --report results/report.html

smoke: ## a miniature of the whole study in under two minutes
	$(MAKE) study CONFIG=config/smoke.yaml

pages: $(ENVIRONMENT) ## the numbers in README, guides and pages of the benchmarks, filled in again from the published tables
	python -m accelerated_evaluation.publishing.pages

crate: $(EXTRAS) study ## run the study, then pack it with its provenance: results/STUDY.crate.zip
	accelerated-evaluation crate $(STUDY)

container: ## the locked environment as an image for Apptainer, environment.sif; needs Docker and Apptainer
	docker build --tag accelerated-evaluation .
	apptainer build environment.sif docker-daemon://accelerated-evaluation:latest

benchmark-samplers: $(ENVIRONMENT) ## simulations that our sampler and others need; half a day, resumable
	python -m pip install --quiet --require-hashes -r benchmarks/environment.txt
	$(SAMPLERS)

benchmark-public: $(ENVIRONMENT) ## public problems, and problems with hidden parts, by our sampler and OpenTURNS; half a day, resumable
	python -m pip install --quiet --require-hashes -r benchmarks/environment.txt
	$(PUBLIC)/public.csv --raw results/benchmarks/public
	$(PUBLIC)/hidden.csv --raw results/benchmarks/hidden --collection hidden --methods surrogate

benchmark-vehicles: $(ENVIRONMENT) ## all vehicles of the study under four laws: exact, and by the sampler; about 20 minutes
	$(VEHICLES)

benchmark-recordings: $(EXTRAS) ## extraction of cut-ins from 1, 10 and 100 million rows: time, memory, correctness; needs 12 GB of disk
	python benchmarks/recordings/run.py

worlds: $(ENVIRONMENT) ## coverage of the intervals in synthetic worlds of 22 kinds; two hours, resumable
	$(WORLDS)

claims: $(ENVIRONMENT) ## repeat the claims of the README with other random numbers, see REPRODUCE.md; resumable: make claims [CLAIMS="paper worlds"]
	python -m pip install --quiet --require-hashes -r benchmarks/environment.txt
	$(REPEATED) -- $(or $(CLAIMS),claims)
	python benchmarks/claims/settle.py $(CLAIMS)

world: $(ENVIRONMENT) ## crashes counted on a simulated motorway, and predicted; an hour, resumable; installs Eclipse SUMO [SETTINGS=my.yaml]
	python -m pip install --quiet --require-hashes -r benchmarks/motorway/environment.txt
	$(MOTORWAY)

lint: $(EXTRAS) ## ruff, snakefmt and mypy
	ruff check .
	ruff format --check .
	snakefmt --check $(RULES)
	python tests/mypy_ratchet.py

test: $(if $(ROOM),$(EXTRAS),lint) ## lint and run the tests, and list the slowest; ROOM=laws for those of one package alone
	pytest --durations 20 $(ROOM:%=tests/unit/%)

test-slurm: $(EXTRAS) ## run the smoke study through a Slurm on this machine; skipped where it cannot be installed
	tests/slurm/install.sh
	pytest -n 0 -s -m slurm tests/slurm

test-studies: $(EXTRAS) ## whole small studies, the benchmarks' own tests and the installed wheel; over an hour
	pytest -m studies --dist worksteal

test-fewruns: $(EXTRAS) ## all tests of the sampler, also those over many seeds; needed if fewruns/ has changed
	pytest -n 2 fewruns/tests

format: $(EXTRAS) ## format the sources for the linters
	ruff check --fix .
	ruff format .
	snakefmt $(RULES)

lock: $(EXTRAS) ## resolve the locks again from pyproject.toml
	$(RESOLVE) --extra study --output-file environment.txt
	$(RESOLVE) --extra recordings --extra fmu --extra cluster --extra provenance --extra scenarios --extra osi --extra simulators --extra dev \
	  --constraint environment.txt --output-file tests/environment.txt
	$(RESOLVE) --extra peers --constraint environment.txt --output-file benchmarks/environment.txt
	$(RESOLVE) --extra world --constraint environment.txt --output-file benchmarks/motorway/environment.txt

clean: ## remove what the study made, keep the environment
	rm -rf results .snakemake
