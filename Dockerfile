# The study with its locked environment in a container:
#
#   docker build --tag accelerated-evaluation .
#   docker run --rm --volume "$PWD/out:/study/out" accelerated-evaluation \
#     bash -c "snakemake --cores 2 --configfile config/smoke.yaml && cp -r figures results out"
#
# `make container` makes an image for Apptainer of it, for the jobs of `snakemake --software-deployment-method apptainer`.
FROM debian:bookworm-slim

RUN apt-get update \
    && apt-get install --yes --no-install-recommends ca-certificates git make python3 python3-venv \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /study

# The environment before the sources, so that an edited source does not install it again.
COPY Makefile pyproject.toml environment.txt README.md LICENSE ./
COPY workflow/accelerated_evaluation/__init__.py workflow/accelerated_evaluation/
COPY fewruns/pyproject.toml fewruns/README.md fewruns/LICENSE fewruns/
COPY fewruns/src/fewruns/__init__.py fewruns/src/fewruns/
RUN make .venv/.installed

COPY . .
RUN touch .venv/.installed
ENV PATH=/study/.venv/bin:$PATH
CMD ["snakemake", "--cores", "2"]
