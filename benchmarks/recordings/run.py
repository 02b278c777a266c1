"""Measure the extraction of cut-ins from raw recordings: time, memory, and whether the cut-ins are right.

Makes recordings of 1, 10 and 100 million rows of targets, extracts their cut-ins in a process of its own, and
writes ``benchmarks/results/recordings.csv``. The recordings of 100 million rows take 9 GB, and the extraction
2 GB beside them for a while; both are removed. ``python benchmarks/recordings/run.py [MILLIONS ...]``
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
from safety_pilot import ROWS_OF_A_SLOT, write_recordings

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "benchmarks" / "results" / "recordings.csv"
KEY = ["device", "trip", "time"]
VALUES = ["lead_speed", "range", "closing_speed"]
TOLERANCE = 1e-4  # [m], [m/s]; the files have seven digits
EXTRACT = """
import json, resource, sys
from accelerated_evaluation.cli import main
status = main(["extract", *sys.argv[1:]])
usage = resource.getrusage(resource.RUSAGE_SELF)
print(json.dumps({"peak_gb": usage.ru_maxrss / 1e6, "cpu_s": usage.ru_utime + usage.ru_stime}))
sys.exit(status)
"""


def largest_size(folder: Path) -> int:
    """Return the bytes of the files that lie below a folder now."""
    sizes = []
    for path in folder.rglob("*"):
        try:
            sizes.append(path.stat().st_size)
        except OSError:  # removed in between
            continue
    return sum(sizes)


def extract(recordings: Path, space: Path) -> tuple[pd.DataFrame, dict]:
    """Run the command on a folder of recordings, and return what it found and what it took."""
    study, found = space / "study.yaml", space / "cut_ins.parquet"
    study.write_text(f"data:\n  source: spmd_raw\n  spmd_raw: {{path: {recordings}}}\n")
    temporary = space / "temporary"
    temporary.mkdir()
    peak, reported = 0, space / "reported.txt"
    with open(reported, "wb") as output:  # a pipe that nobody reads would fill, and stop the command
        process = subprocess.Popen(
            [sys.executable, "-c", EXTRACT, str(study), str(found)],
            stdout=output,
            env=os.environ | {"TMPDIR": str(temporary)},
        )
        while process.poll() is None:
            peak = max(peak, largest_size(temporary))
            time.sleep(1)
    if process.returncode:
        raise SystemExit(process.returncode)
    taken = json.loads(reported.read_text(encoding="utf-8").splitlines()[-1])
    taken["temporary_gb"] = peak / 1e9
    return pd.read_parquet(found), taken


def compare(planted: pd.DataFrame, found: pd.DataFrame) -> dict[str, int]:
    """Count the cut-ins planted, found, missed and invented; a wrong value is a miss and an invention."""
    both = planted.merge(found, on=KEY, suffixes=("", "_found"))
    right = np.all([np.abs(both[name] - both[f"{name}_found"]) < TOLERANCE for name in VALUES], axis=0).sum()
    return {
        "planted": len(planted),
        "found": int(right),
        "missed": len(planted) - int(right),
        "invented": len(found) - int(right),
    }


def measure(millions: float, space: Path) -> dict[str, float]:
    """Make recordings, extract their cut-ins, and compare."""
    slots = round(millions * 1e6 / ROWS_OF_A_SLOT)
    rows, planted = write_recordings(space / "recordings", slots, np.random.default_rng(2016))
    size = largest_size(space / "recordings")
    found, taken = extract(space / "recordings", space)
    return {"target_rows": rows, "gb": size / 1e9, **taken, **compare(planted, found)}


def main() -> None:
    """Measure each size in turn, and write the table after each."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("millions", nargs="*", type=float, default=[1, 10, 100], help="rows of targets")
    lines = []
    for millions in parser.parse_args().millions:
        with tempfile.TemporaryDirectory(prefix="recordings-") as space:
            lines.append(measure(millions, Path(space)))
        table = pd.DataFrame(lines).round({"gb": 2, "peak_gb": 2, "temporary_gb": 2, "cpu_s": 0})
        table.to_csv(RESULTS, index=False)
        print(table.to_string(index=False), flush=True)


if __name__ == "__main__":
    main()
