"""The finished results of a study, each under the name that figures and tables use for it."""

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import read_json
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.laws.paper.independent import IndependentLaw
from accelerated_evaluation.publishing.book.catalogue import Contents
from accelerated_evaluation.publishing.study_tables import TABLES
from accelerated_evaluation.publishing.tables.display import display_in_notebooks
from accelerated_evaluation.publishing.tables.formats import as_markdown
from accelerated_evaluation.records.encounter_table import read_encounters
from accelerated_evaluation.records.report import read_report, summary
from accelerated_evaluation.records.sources import describe
from accelerated_evaluation.records.verdict import Verdict
from accelerated_evaluation.scenarios import SCENARIOS
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.protocol import Scenario

if TYPE_CHECKING:
    from accelerated_evaluation.laws import Factors


class Study:
    """The finished results of a study; each is read when it is first used, and then cached.

    In a notebook, tables are displayed as `publishing.tables.display.as_html` writes them from then on.

    The parameters of a figure or table are the names of the results that it uses: a parameter ``estimates``
    is read from the property ``estimates`` of this class (`publishing.published.show`). A file name with
    parts in braces represents several files. ``used`` are the results that were read, and the figures and
    tables that were published; tables are in ``tables`` inside the folder of the figures. Each property
    raises InputError with the command that makes its result, if this does not exist yet.
    """

    def __init__(self, results: str | Path, figures: str | Path) -> None:
        display_in_notebooks()
        self.results, self.figures = Path(results), Path(figures)
        self.used = Contents([], [], [])

    @classmethod
    def named(cls, name: str) -> "Study":
        """Return the study with the given name that ran in the working folder."""
        return cls(Path("results") / name, Path("figures") / name)

    def path(self, name: str, **parts: str) -> Path:
        """Return the path of a result, such as ``cross_entropy/{method}_0.json`` with a method.

        InputError is raised if the file does not exist.
        """
        if name not in self.used.reads:
            self.used.reads.append(name)
        path = self.results / name.format(**parts)
        if not path.is_file():
            relative = f"results/{self.results.name}/{path.relative_to(self.results).as_posix()}"
            raise InputError(
                str(path),
                seen="no such file",
                expected=f"a finished result of the study {self.results.name}",
                change="In the folder of the project, run `make study`, or make this result alone by "
                f"`snakemake --cores 2 {relative}`, with the study's own --configfile.",
            )
        return path

    def __getattr__(self, name: str) -> pd.DataFrame:
        """Read a table by its name in `TABLES`, and cache it."""
        if name not in TABLES:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        self.__dict__[name] = self.table(TABLES[name])
        return self.__dict__[name]

    def table(self, name: str) -> pd.DataFrame:
        """Read a table of results from a CSV file; InputError is raised if the file does not exist."""
        table = pd.read_csv(self.path(name))
        if "study" in table:  # pandas would read a name such as NaN or 007 as a number
            table["study"] = self.results.name
        return table

    def _law(self, name: str) -> IndependentLaw:
        return read_law(self.path(name), self.encounters)

    # What the study is.

    @cached_property
    def config(self) -> dict[str, Any]:
        """The resolved configuration."""
        return read_json(self.path("config.json"))

    @property
    def name(self) -> str:
        """Name of the study."""
        return self.config["study"]

    @property
    def source(self) -> str:
        """The description of the data."""
        if self.scenario is not CUT_IN:
            return f"records of the scenario {self.scenario.name.replace('_', ' ')}"
        data = self.config["data"]
        return describe(data)

    @property
    def scenario(self) -> Scenario:
        """The scenario. Results of version 0.2 do not name it; their scenario is the cut-in."""
        return SCENARIOS[self.config.get("scenario", {}).get("name", CUT_IN.name)]

    @property
    def scenario_headline(self) -> str:
        """Study, scenario, vehicle and root seed as one line of Markdown."""
        vehicle, seed = self.config["vehicle"]["name"], self.config["seed"]
        what = as_markdown(self.scenario.description)
        text = f"Study **{self.name}**: {what}. Vehicle {as_markdown(vehicle)}. Root seed {seed}."
        return text + self._doubts

    @property
    def headline(self) -> str:
        """Study, data and root seed as one line of Markdown."""
        text = f"Study **{self.name}**. Data: {as_markdown(self.source)}. Root seed {self.config['seed']}."
        return text + self._doubts

    @property
    def _doubts(self) -> str:
        """What the checks of the records found, as Markdown that begins with a space; empty if nothing."""
        verdict = self.verdict
        if verdict.stops:
            return f" **{as_markdown(summary(self.records_report))}**"
        return f" Records: {as_markdown(verdict.in_short)}." if verdict.in_short else ""

    @property
    def alpha(self) -> float:
        """One minus the level of the intervals of the paper's methods."""
        return self.config["importance_sampling"]["alpha"]

    @property
    def beta(self) -> float:
        """Relative half-width of the interval at which an estimate has converged."""
        return self.config["importance_sampling"]["beta"]

    @property
    def segments(self) -> tuple[str, ...]:
        """Names of the segments, in order of lead speed."""
        return self.piecewise.segments

    @property
    def first_segment(self) -> str:
        """Name of the slowest segment, in which nearly all crashes happen."""
        return self.segments[0]

    @property
    def paper_interval(self) -> tuple[float, float]:
        """The paper's interval of the crash probability (section VI.C)."""
        low, high = self.config["uncertainty"]["sampling_interval"]
        return low, high

    # The records.

    @cached_property
    def encounters(self) -> pd.DataFrame:
        """The checked encounter table, a row for each lane change."""
        path = self.path("encounters.parquet")
        return read_encounters(path) if self.scenario.has_sources else pd.read_parquet(path)

    @cached_property
    def account(self) -> pd.DataFrame:
        """Table of the reasons for which rows of the records are left out, with the number of rows."""
        return pd.read_csv(self.path("encounters_account.csv"), keep_default_na=False)

    @cached_property
    def records_report(self) -> pd.DataFrame:
        """The results of the checks of the records."""
        return read_report(self.path("records_report.csv"))

    @property
    def verdict(self) -> Verdict:
        """The verdict on the records, which is shown with every answer."""
        return Verdict.of(self.records_report)

    # The laws of cut-ins.

    @cached_property
    def two_pieces(self) -> IndependentLaw:
        """The piecewise law whose R^-1 has two pieces."""
        return self._law("models/two_pieces.json")

    @cached_property
    def three_pieces(self) -> IndependentLaw:
        """The piecewise law whose R^-1 has three pieces."""
        return self._law("models/three_pieces.json")

    @cached_property
    def single(self) -> IndependentLaw:
        """The single parametric law."""
        return self._law("models/single.json")

    @property
    def models(self) -> dict[str, IndependentLaw]:
        """All fitted laws by name."""
        return {"two_pieces": self.two_pieces, "three_pieces": self.three_pieces, "single": self.single}

    @property
    def variant(self) -> str:
        """Name of the piecewise law from which all cut-ins of this study are drawn."""
        return self.config["models"]["inverse_range"]["variant"]

    @property
    def piecewise(self) -> IndependentLaw:
        """The piecewise law from which all cut-ins of this study are drawn."""
        return self.models[self.variant]

    @property
    def shares(self) -> dict[str, float]:
        """Share of each segment in the lane changes."""
        return self.piecewise.shares

    # What the methods found.

    @cached_property
    def proposals(self) -> "dict[str, Mapping[str, Factors]]":
        """The accelerated distributions f* of the first seed, by method and segment."""
        # Imported here because this import loads the compiled vehicle, which takes time.
        from accelerated_evaluation.methods.cross_entropy.proposals import read_proposals

        methods = self.trace["method"].unique()
        paths = {method: self.path("cross_entropy/{method}_0.json", method=method) for method in methods}
        return {method: read_proposals(path).factors for method, path in paths.items()}

    @cached_property
    def replicates(self) -> pd.DataFrame:
        """Number of simulations and estimate of every replicate of every method.

        The column ``together`` is the number of all simulations of a replicate.
        """
        table = self.table("estimates.csv")
        return table.assign(together=table["learning"] + table["estimating"])

    @cached_property
    def estimates(self) -> pd.DataFrame:
        """The estimates by importance sampling of all replicates, at convergence.

        Rows without an effective sample size are left out, because they are estimates of crude Monte Carlo,
        which have no weights.
        """
        weighted = self.replicates.dropna(subset="effective_sample_size")
        return weighted.rename(columns={"estimating": "simulations"}).reset_index(drop=True)

    # The ground truth.

    @property
    def truth(self) -> pd.Series:
        """Exact crash probability over all segments, ``probability``, and its ``standard_error``."""
        return self.exact.set_index("segment").loc["all"]
