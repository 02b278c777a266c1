"""One reader of a study: every finished result, under the name by which figures and tables ask for it."""

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import read_json
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.laws.paper.independent import IndependentLaw
from accelerated_evaluation.publishing.tables.formats import as_markdown
from accelerated_evaluation.records.encounter_table import read_encounters
from accelerated_evaluation.records.sources import describe

if TYPE_CHECKING:
    from accelerated_evaluation.laws import Factors


class Study:
    """The finished results of a study; each is read when it is first asked for, and then kept.

    A figure or a table says by its parameters what it reads: a parameter ``estimates`` is given the property
    ``estimates`` of this class (`publishing.published.show`). From the code of this class, without running
    it, `publishing.book.catalogue` finds out on which files a notebook depends. Each file is therefore named
    as a literal in a call of `path`, `_table` or `_law`. A part in braces stands for several files.

    Parameters
    ----------
    results, figures
        Folder of the study's results, and folder for its figures; tables go into ``tables`` in the latter.

    Raises
    ------
    InputError
        By every property whose result has not been made, with the command that makes it.
    """

    def __init__(self, results: str | Path, figures: str | Path) -> None:
        self.results, self.figures = Path(results), Path(figures)

    def path(self, name: str, **parts: str) -> Path:
        """Return the path of a result, which has to be there; ``parts`` replace what stands in braces."""
        path = self.results / name.format(**parts)
        if not path.is_file():
            raise InputError(
                str(path),
                seen="no such file",
                expected=f"a finished result of the study {self.results.name}",
                change=f"Make it with `snakemake --cores 2 {path}`, and the study's own --configfile.",
            )
        return path

    def _table(self, name: str) -> pd.DataFrame:
        table = pd.read_csv(self.path(name))
        if "study" in table:  # pandas would take a name such as NaN or 007 for a number
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
        """What the data are, in words."""
        data = self.config["data"]
        return describe(data)

    @property
    def headline(self) -> str:
        """Study, data and root seed in one line of Markdown."""
        return f"Study **{self.name}**. Data: {as_markdown(self.source)}. Root seed {self.config['seed']}."

    @property
    def alpha(self) -> float:
        """Intervals are 100 (1 - alpha) %."""
        return self.config["importance_sampling"]["alpha"]

    @property
    def beta(self) -> float:
        """Relative half-width of the interval at which an estimate has converged."""
        return self.config["importance_sampling"]["beta"]

    @property
    def segments(self) -> tuple[str, ...]:
        """Names of the segments, by rising lead speed."""
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
        return read_encounters(self.path("encounters.parquet"))

    @cached_property
    def account(self) -> pd.DataFrame:
        """Every reason to leave out a row of the records, and how many rows it applies to."""
        return pd.read_csv(self.path("encounters_account.csv"), keep_default_na=False)

    @cached_property
    def records_report(self) -> pd.DataFrame:
        """What each check of the records says."""
        return pd.read_csv(self.path("records_report.csv"), keep_default_na=False)

    @cached_property
    def segment_counts(self) -> pd.DataFrame:
        """Number and share of the lane changes in each segment."""
        return self._table("segments.csv")

    @cached_property
    def dependence(self) -> pd.DataFrame:
        """Kendall's tau of each pair of variables, inside each segment."""
        return self._table("dependence.csv")

    # The laws of cut-ins.

    @cached_property
    def candidates(self) -> pd.DataFrame:
        """Log-likelihood, AIC and rank of all candidate families."""
        return self._table("candidates.csv")

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
    def trace(self) -> pd.DataFrame:
        """Every iteration of every Cross-Entropy search."""
        return self._table("cross_entropy_trace.csv")

    @cached_property
    def proposals(self) -> "dict[str, Mapping[str, Factors]]":
        """The accelerated distributions f* of the first seed, by method and segment."""
        # Imported here, because it takes the compiled vehicle along, which the other results do not need.
        from accelerated_evaluation.methods.cross_entropy.proposals import read_proposals

        methods = self.trace["method"].unique()
        paths = {method: self.path("cross_entropy/{method}_0.json", method=method) for method in methods}
        return {method: read_proposals(path).factors for method, path in paths.items()}

    @cached_property
    def replicates(self) -> pd.DataFrame:
        """What every replicate of every method costs and finds; ``together`` counts all simulations."""
        table = self._table("estimates.csv")
        return table.assign(together=table["learning"] + table["estimating"])

    @cached_property
    def estimates(self) -> pd.DataFrame:
        """The estimates of all replicates of importance sampling, at convergence.

        They are told from others by their weights, which have an effective sample size.
        """
        weighted = self.replicates.dropna(subset="effective_sample_size")
        return weighted.rename(columns={"estimating": "simulations"}).reset_index(drop=True)

    @cached_property
    def course(self) -> pd.DataFrame:
        """How these estimates went on the way, and beyond convergence."""
        return self._table("estimates_course.csv")

    @cached_property
    def crude(self) -> pd.DataFrame:
        """What crude Monte Carlo found, over all segments and in each."""
        return self._table("crude.csv")

    @cached_property
    def runs(self) -> pd.DataFrame:
        """Every simulation of every replicate of the surrogate-guided sampler."""
        return self._table("estimates_runs.csv")

    # The ground truth.

    @cached_property
    def exact(self) -> pd.DataFrame:
        """Exact crash probabilities, over all segments and in each, with their standard errors."""
        return self._table("exact.csv")

    @property
    def truth(self) -> pd.Series:
        """Exact crash probability over all segments, and its standard error."""
        return self.exact.set_index("segment").loc["all"]

    @cached_property
    def convergence(self) -> pd.DataFrame:
        """Exact crash probabilities by resolution of the crash map."""
        return self._table("convergence.csv")

    @cached_property
    def variation(self) -> pd.DataFrame:
        """Exact coefficient of variation of a weight under each f*."""
        return self._table("variation.csv")

    @cached_property
    def severity(self) -> pd.DataFrame:
        """Probabilities of crashes above impact speeds, and of near misses."""
        return self._table("severity.csv")

    @cached_property
    def impact_speed(self) -> pd.DataFrame:
        """Mean and quantiles of the impact speed of crashes."""
        return self._table("impact_speed.csv")

    @cached_property
    def sensitivity(self) -> pd.DataFrame:
        """Exact crash probability with one choice changed at a time."""
        return self._table("sensitivity.csv")

    @cached_property
    def uncertainty(self) -> pd.DataFrame:
        """Budget of the uncertainty of the crash probability, by source."""
        return self._table("uncertainty.csv")

    @cached_property
    def bootstrap(self) -> pd.DataFrame:
        """Crash probability of the law refitted to each resample of the lane changes."""
        return self._table("bootstrap.csv")

    # Laws with dependence.

    @cached_property
    def laws(self) -> pd.DataFrame:
        """Held-out scores, weights and crash probabilities of laws, and whether the records refuse them."""
        return self._table("laws/laws.csv")

    @cached_property
    def calibration(self) -> pd.DataFrame:
        """Recorded against expected counts of cut-ins and near misses near the crash set."""
        return self._table("laws/calibration.csv")

    @cached_property
    def crash_places(self) -> pd.DataFrame:
        """Crashes drawn from laws: where each law puts them."""
        return self._table("laws/crash_places.csv")

    @cached_property
    def answer(self) -> pd.DataFrame:
        """The probability of a crash and of near misses, all that is not known included."""
        return self._table("laws/answer.csv")

    @cached_property
    def exposure(self) -> pd.DataFrame:
        """Rates of cut-ins, crashes and near misses per kilometre and hour, as far as these are known."""
        return self._table("laws/exposure.csv")

    @cached_property
    def vehicles(self) -> pd.DataFrame:
        """Crash probabilities of vehicles, and their ratios to the careful human's."""
        return self._table("laws/vehicles.csv")

    @cached_property
    def answer_draws(self) -> pd.DataFrame:
        """Draws of the crash probability, and the law of each."""
        return self._table("laws/answer_draws.csv")

    @cached_property
    def answer_budget(self) -> pd.DataFrame:
        """Where the uncertainty of the answer comes from."""
        return self._table("laws/answer_budget.csv")

    @cached_property
    def answer_thresholds(self) -> pd.DataFrame:
        """The answer as each threshold alone gives it."""
        return self._table("laws/answer_thresholds.csv")

    @cached_property
    def data_quality(self) -> pd.DataFrame:
        """The answer under other readings of the records."""
        return self._table("laws/data_quality.csv")

    @cached_property
    def counted_crashes(self) -> pd.DataFrame:
        """Crash rates per million miles: those that the study predicts, and those that were counted."""
        return self._table("counted_crashes.csv")

    # What happens.

    @cached_property
    def happened(self) -> pd.DataFrame:
        """The likeliest ways to crash and the nearest records, with what they end in."""
        return self._table("happened/encounters.csv")

    @cached_property
    def traces(self) -> pd.DataFrame:
        """Every state of these encounters."""
        return self._table("happened/traces.csv")

    @cached_property
    def preventable(self) -> pd.DataFrame:
        """Where each vehicle can no longer avoid the crash, by lead speed and range."""
        return self._table("happened/preventable.csv")

    @cached_property
    def coverage(self) -> pd.DataFrame:
        """How often intervals hold the exact probability, by method and way to stop."""
        return self._table("coverage.csv")
