#!/usr/bin/env bash
# Install the Slurm that tests/slurm starts, where that is possible; the tests are skipped where it is not.
set -euo pipefail

if command -v slurmctld > /dev/null || [ -x /usr/sbin/slurmctld ]; then
  exit 0
fi
if [ "$(id -u)" -ne 0 ] || ! command -v apt-get > /dev/null; then
  echo "Slurm is not installed, and only root can install it, by apt-get: tests/slurm will be skipped" >&2
  exit 0
fi
export DEBIAN_FRONTEND=noninteractive
if ! { apt-get -qq update && apt-get -qq install --yes --no-install-recommends slurm-wlm munge; } > /dev/null; then
  echo "apt-get could not install slurm-wlm and munge: tests/slurm will be skipped" >&2
fi
