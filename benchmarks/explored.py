"""Compare the numbers with which the explorer of a study starts with those of plain importance sampling.

    python benchmarks/explored.py [STUDY] --output FILE.csv

The page of the explorer computes its numbers in JavaScript. Its own code is run by Node.js, without a
browser, and the errors come from parts of the lines of the page. The study has to be finished, in
``results/STUDY``. The columns are those of the table ``second_ways`` of a study.
"""

import argparse
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation.answer.second_ways import Key, Means, Plain, ratio, summary
from accelerated_evaluation.answer.study_tables import UNDER_TEST
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import read_json, write_csv
from second_ways import compared

PARTS = 8  # number of parts of the lines, a power of 2
# Print the probabilities of a crash under each draw of the answer, by vehicle and part of the lines.
RUN = """
const [page, parts, ...names] = process.argv.slice(1);
const html = require("fs").readFileSync(page, "utf8");
const block = (id) => new RegExp(`id="${id}">(.*?)</script>`, "s").exec(html)[1];
const [simulator, engine] = [...html.matchAll(/<script>(.*?)<\\/script>/gs)].map((found) => found[1]);
require("vm").runInThisContext(`${simulator}\n${engine}\nglobalThis.Engine = Engine;`);
Engine.load(block("data"), block("arrays")).then((explorer) => {
  const all = explorer.data.line_probability, { answered } = explorer.meta.laws;
  const drawn = (vehicle, part) => {
    explorer.data.line_probability = all.map((value, line) => (line % parts === part ? parts * value : 0));
    const numbers = explorer.numbers(vehicle, vehicle.sliders.map((slider) => slider.start));
    return Array.from(explorer.explore(vehicle, numbers, null).draws.slice(0, answered));
  };
  const of = (name) => Array.from({ length: parts }, (_, part) => drawn(explorer.vehicle(name), part));
  console.log(JSON.stringify(Object.fromEntries(names.map((name) => [name, of(name)]))));
});
"""


def starting_numbers(page: Path, tested: str, reference: str) -> dict[Key, tuple[float, float]]:
    """Return the numbers with which a page starts, each with its error, as numbers of tables of the study."""
    if (node := shutil.which("node")) is None:
        raise InputError("node", seen="no such program", expected="Node.js", change="Install Node.js.")
    command = [node, "-e", RUN, str(page), str(PARTS), tested, reference]
    found = json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)
    parts = {name: np.array(each)[:, :, None] for name, each in found.items()}

    def made(means: Means) -> dict[Key, float]:
        own, other = (means[name][:, 0] for name in (tested, reference))
        rows = {("vehicles", UNDER_TEST): summary(own), ("vehicles", reference): summary(other)}
        rows["compared", reference] = ratio(own, other)
        return {(*row, column): value for row, values in rows.items() for column, value in values.items()}

    return Plain(parts).numbers(made)


def main() -> None:
    """Compare the starting numbers of the explorer of a study, and write their table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("study", nargs="?", default="spmd", metavar="STUDY")
    parser.add_argument("--reference", default="cc_human", help="the other vehicle that the page shows")
    parser.add_argument("--output", type=Path, required=True)
    given = parser.parse_args()
    study = Path("results") / given.study
    tested = read_json(study / "config.json")["vehicle"]["name"]
    table = pd.read_csv(study / "second_ways.csv", keep_default_na=False, na_values=[""])
    known = table.dropna(subset="second").set_index(["table", "row", "column"])[["second", "second_error"]]
    second = {key: (value, error) for key, value, error in known.itertuples()}
    first = starting_numbers(study / "explorer.html", tested, given.reference)
    write_csv(given.output, compared(first, second))


if __name__ == "__main__":
    main()
