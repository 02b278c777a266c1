"""The finished results of a study, each under the name that figures and tables use for it."""

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pandas as pd

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import read_json
from accelerated_evaluation.crash_map.uncertainty import PAPER_INTERVAL
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.laws.paper.models import IndependentLaw
from accelerated_evaluation.methods.cross_entropy.method import CONSTANTS
from accelerated_evaluation.publishing.book.catalogue import Contents
from accelerated_evaluation.publishing.tables.display import as_markdown, display_in_notebooks, reproducible
from accelerated_evaluation.publishing.tables.paper_claims import PREMISES
from accelerated_evaluation.publishing.texts import fill, fill_in_notebooks
from accelerated_evaluation.records.segments import read_encounters
from accelerated_evaluation.records.verdict import Verdict, read_report, summary
from accelerated_evaluation.scenarios import DEFAULT, SCENARIOS
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.scenarios.record_table import named_records_of
from accelerated_evaluation.study.configuration import load_modules
from accelerated_evaluation.study.limits import value_of

if TYPE_CHECKING:
    from accelerated_evaluation.laws import Factors

TABLES = {
    # Number and share of the lane changes in each segment.
    "segment_counts": "segments.csv",
    # Kendall's tau of each pair of variables, inside each segment.
    "dependence": "dependence.csv",
    # Ratio of the largest to the smallest quantile of TTC^-1 of the segments.
    "similarity": "similarity.csv",
    # Log-likelihood, AIC and rank of all candidate families.
    "candidates": "candidates.csv",
    # Every iteration of every Cross-Entropy search.
    "trace": "cross_entropy_trace.csv",
    # Estimates of importance sampling after increasing numbers of simulations, also beyond convergence.
    "course": "estimates_course.csv",
    # Estimates of crude Monte Carlo, over all segments and in each.
    "crude": "crude.csv",
    # Exact crash probabilities, over all segments and in each, with their standard errors.
    "exact": "exact.csv",
    # Exact crash probabilities by resolution of the crash map.
    "convergence": "convergence.csv",
    # Exact coefficient of variation of the weight of a simulation under each f*.
    "variation": "variation.csv",
    # Searches of the first segment with more seeds and more updates, and how good their f* are.
    "repeated_searches": "repeated_searches.csv",
    # Probabilities of crashes above impact speeds, and of near misses.
    "severity": "severity.csv",
    # Mean and quantiles of the impact speed of crashes.
    "impact_speed": "impact_speed.csv",
    # Exact crash probability with one choice changed at a time.
    "sensitivity": "sensitivity.csv",
    # Budget of the uncertainty of the crash probability, by source.
    "uncertainty": "uncertainty.csv",
    # Crash probability of the law refitted to each resample of the lane changes.
    "bootstrap": "bootstrap.csv",
    # Held-out scores, weights and crash probabilities of laws, and whether the records contradict them.
    "laws": "laws/laws.csv",
    # For other scenarios than the cut-in: criteria, held-out scores and weights of the joint laws.
    "joint_laws": "laws/joint_laws.csv",
    # Recorded against expected counts of cut-ins and near misses near the crash set.
    "calibration": "laws/calibration.csv",
    # The same by block of the records: cells outside their limits, those expected by chance, and dispersion.
    "fold_calibration": "laws/fold_calibration.csv",
    # Random predicted crashes: lead speed, range and closing speed, and how far they are from the records.
    "crash_places": "laws/crash_places.csv",
    # Shares of the answer by distance of the predicted crashes from the records.
    "extrapolation": "laws/extrapolation.csv",
    # Intervals of near misses that allow for clusters of critical records.
    "near_misses": "laws/near_misses.csv",
    # Crash probability for other choices of laws, weights, priors and splines.
    "choices": "laws/choices.csv",
    # Probabilities of crashes and impacts with and without a limit to the speed of the host.
    "host_limit": "laws/host_limit.csv",
    # Crash probability from near misses alone, by the number of the largest margins that are fitted.
    "near_miss_answer": "laws/near_miss_answer.csv",
    # The largest margins of the records to a crash, and the distribution that is fitted to them.
    "margins": "laws/margins.csv",
    # Expected and counted records beyond the levels of the far tail, by law, lead speed and range.
    "far_records": "laws/far_records.csv",
    # The probability of a crash and of near misses, with the uncertainty from data, laws and sampling.
    "answer": "laws/answer.csv",
    # Verdicts on the criteria of the configuration, with one-sided bounds, and what would decide them.
    "criteria": "laws/criteria.csv",
    "deciding": "laws/deciding.csv",
    # Rates of cut-ins, crashes and near misses per kilometre and per hour, if distance and time are known.
    "exposure": "laws/exposure.csv",
    # Crash probabilities of vehicles, and their ratios to the careful human's.
    "vehicles": "laws/vehicles.csv",
    # Expected number of injured drivers per cut-in, and per million kilometres and hours if these are known.
    "injuries": "laws/injuries.csv",
    # The same per cut-in, for each pair of published risk curves.
    "injuries_by_curve": "laws/injuries_by_curve.csv",
    # Budget of the uncertainty of the number of injured drivers, by source.
    "injury_budget": "laws/injury_budget.csv",
    # The published curves of the risk of injury.
    "injury_curves": "laws/injury_curves.csv",
    # Ratios of the number of injured drivers with the vehicle under test to those with the other vehicles.
    "risk_balance": "laws/risk_balance.csv",
    # Random draws of the crash probability of every compared vehicle.
    "vehicle_draws": "laws/vehicle_draws.csv",
    # Random draws of the crash probability, with the law of each.
    "answer_draws": "laws/answer_draws.csv",
    # Budget of the uncertainty of the crash probability under laws with dependence, by source.
    "answer_budget": "laws/answer_budget.csv",
    # Crash probability for each threshold of the laws' tails alone.
    "answer_thresholds": "laws/answer_thresholds.csv",
    # Crash probability for alternative treatments of the records.
    "data_quality": "laws/data_quality.csv",
    # Crash rates per million miles: those that the study predicts, and those that were counted.
    "counted_crashes": "counted_crashes.csv",
    # Crashes and near-crashes that are predicted for human drivers, and those that were counted.
    "human_predictions": "human_predictions.csv",
    # Crash probabilities if the lead vehicle changes its speed.
    "lead_motion": "lead_motion.csv",
    # The same with European lead motion, in place of American.
    "lead_motion_europe": "lead_motion_europe.csv",
    # One crash rate of all cut-ins, by its parts, with the uncertainty of lead motion and exposure.
    "all_cut_ins": "all_cut_ins.csv",
    # Every number of the tables of the answer, and the same by a second way.
    "second_ways": "second_ways.csv",
    # The most probable kinds of crashes and the most critical records, with their outcomes.
    "happened": "happened/encounters.csv",
    # States of both cars over time in the encounters of `happened`.
    "traces": "happened/traces.csv",
    # Closing speed from which on each vehicle always crashes, by lead speed and range.
    "preventable": "happened/preventable.csv",
    # Tests that regulations prescribe, by vehicle.
    "prescribed": "happened/prescribed.csv",
    # Crash probabilities of vehicles with other steps of the simulation, as ratios.
    "numerical_error": "happened/numerical_error.csv",
    # Shares of encounters and crashes by the size of a variable.
    "crash_shares": "laws/crash_shares.csv",
    # Mean and quantiles of the impact speed of crashes in another scenario than the cut-in, with intervals.
    "impact_speeds": "laws/impact_speeds.csv",
    # Estimates of all replicates of all methods for the law with the largest weight.
    "scenario_estimates": "scenario/estimates.csv",
    # Number of published verdicts that the vehicle reproduces.
    "scenario_agreement": "scenario/agreement.csv",
    # For a slow vehicle: estimate under the mean law, simulations, those that crashed, comparisons.
    "sampled_estimate": "laws/estimate.csv",
    "sampled_runs": "laws/runs.csv",
    "sampled_crashes": "laws/crashes.csv",
    "compared": "laws/compared.csv",
    # Share of intervals that contain the exact probability, by method and stopping rule.
    "coverage": "coverage.csv",
}

# Results that are no tables, or that are computed from tables, by their names in `Study`.
FILES = TABLES | {name: f"models/{name}.json" for name in ("two_pieces", "three_pieces", "single")}
FILES |= {"account": "encounters_account.csv", "truth": TABLES["exact"]}
FILES |= dict.fromkeys(("replicates", "estimates"), "estimates.csv")
FILES |= {"models": FILES["single"], "piecewise": FILES["two_pieces"]}


def read_result(path: Path) -> pd.DataFrame:
    """Return a table of a finished study; InputError is raised if it is damaged."""
    try:
        return pd.read_csv(path)
    except ValueError as error:  # pandas' and Unicode errors derive from it
        raise _damaged(path, error) from error


def _configuration(path: Path) -> dict[str, Any]:
    """Return the configuration of a finished study; InputError is raised if it is damaged."""
    try:
        config = read_json(path)
    except ValueError as error:
        raise _damaged(path, error) from error
    sections = [config, config.get("scenario", {})] if isinstance(config, dict) else [config]
    if not all(isinstance(each, dict) for each in sections) or not isinstance(config.get("study"), str):
        raise _damaged(path, "no configuration of a study")
    return config


def _damaged(path: Path, reason: object) -> InputError:
    return InputError(
        str(path),
        seen=f"content that cannot be read ({reason})",
        expected="a result as the study has written it",
        change="Remove the file, and run the study again, which makes it once more.",
    )


def _setting(key: str, meaning: str) -> Any:  # noqa: ANN401
    """Return a property of a study that is a value of its configuration."""
    return property(lambda study: value_of(study.config, key), doc=meaning)


def _law(path: str) -> Any:  # noqa: ANN401
    """Return a property of a study that is a law in a file of its results."""
    return cached_property(lambda study: read_law(study.path(path), study.encounters))


class Study:
    """The finished results of a study; each is read when it is first used, and then cached.

    In a notebook, tables are displayed as `publishing.tables.display.as_html` writes them from then on, and
    cells that begin with ``%%text`` as `publishing.texts.fill` fills them in.

    The parameters of a figure or table are the names of the results that it uses: a parameter ``estimates``
    is read from the property ``estimates`` of this class (`publishing.published.show`). A file name with
    parts in braces represents several files. ``used`` are the results that were read, and the figures and
    tables that were published; tables are in ``tables`` inside the folder of the figures. Each property
    raises InputError with the command that makes its result, if this does not exist yet.

    The user's modules that the configuration of the study names are imported when the study is opened,
    because its results may contain members of theirs, such as a law. Their paths begin in the folder in which
    the study ran. InputError is raised if such a module does not exist any more, or cannot be used.
    """

    def __init__(self, results: str | Path, figures: str | Path) -> None:
        display_in_notebooks()
        fill_in_notebooks()
        self.results, self.figures = Path(results), Path(figures)
        self.used = Contents([], [], [])
        if (path := self.results / "config.json").is_file():
            load_modules(_configuration(path), [self.results.parent])  # the folder with ``results``

    @classmethod
    def named(cls, name: str) -> "Study":
        """Return the study with the given name that ran in the working folder."""
        if name in ("..", "") or Path(name).name != name:
            expected = "the name of a study, such as spmd, and no path"
            raise InputError(
                "the study", seen=repr(name), expected=expected, change="Name a folder in `results`."
            )
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

    def has(self, *names: str) -> bool:
        """Return whether the study makes all results with the given names, as its configuration asks for.

        A study of a vehicle that is slow to simulate, for example, has no ``exact``. A file that an earlier
        study of the same name left behind is no result of this study. Results that the study has count as
        read.
        """
        if "contents" not in self.__dict__:
            self.__dict__["contents"] = set(read_json(self.path("contents.json")))
        paths = [FILES[name] for name in names if name in FILES]
        made = [path for path in paths if path in self.__dict__["contents"]]
        self.used.reads.extend(path for path in made if path not in self.used.reads)
        return made == paths

    def __getattr__(self, name: str) -> pd.DataFrame:
        """Read a table by its name in `TABLES`, and cache it."""
        if name not in TABLES:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        self.__dict__[name] = self.table(TABLES[name])
        return self.__dict__[name]

    def table(self, name: str) -> pd.DataFrame:
        """Read a table of results from a CSV file; InputError is raised if the file does not exist.

        Numbers are rounded to the digits that do not depend on the processor, so that figures, tables and
        texts do not depend on it either.
        """
        table = reproducible(read_result(self.path(name)))
        if "study" in table:  # pandas would read a name such as NaN or 007 as a number
            table["study"] = self.results.name
        return table

    # What the study is.

    name = _setting("study", "Name of the study.")
    seed = _setting("seed", "The root seed.")
    is_slow = _setting("simulations.slow", "Whether the vehicle is simulated only a few hundred times.")
    sampling = _setting("importance_sampling", "Level, half-width, numbers of events and of replicates.")
    alpha = _setting("importance_sampling.alpha", "One minus the level of the intervals of the methods.")
    beta = _setting("importance_sampling.beta", "Relative half-width at which an estimate has converged.")
    cap = _setting("models.closing_speed_max", "Largest closing speed of the paper's laws [m/s].")
    variant = _setting("models.inverse_range.variant", "The piecewise law from which cut-ins are drawn.")

    @cached_property
    def config(self) -> dict[str, Any]:
        """The resolved configuration; InputError is raised if the file is damaged."""
        return _configuration(self.path("config.json"))

    @property
    def source(self) -> str:
        """The description of the data."""
        return named_records_of(self.scenario, self.config).description

    @property
    def scenario(self) -> Scenario:
        """The scenario. Results of version 0.2 do not name it; their scenario is the cut-in."""
        return SCENARIOS[self.config.get("scenario", {}).get("name", DEFAULT)]

    @property
    def headline(self) -> str:
        """Study, data and root seed as one line of Markdown."""
        text = f"Study **{self.name}**. Data: {as_markdown(self.source)}. Root seed {self.config['seed']}."
        verdict = self.verdict
        if verdict.stops:
            return f"{text} **{as_markdown(summary(self.records_report))}**"
        return f"{text} Records: {as_markdown(verdict.in_short)}." if verdict.in_short else text

    def caption(self, folder: Path, name: str) -> list[str]:
        """Return the paragraphs of the caption of a figure or table, with its placeholders filled in.

        The Snakemake report reads the same files, ``<name>.rst``, so their placeholders use the configuration
        by the name ``snakemake.config``.
        """
        text = (folder / f"{name}.rst").read_text(encoding="utf-8")
        return fill(text, {"snakemake": SimpleNamespace(config=self.config)}).strip().split("\n\n")

    @property
    def scope(self) -> tuple[str, dict[str, float]]:
        """Name of the vehicle under test, and limits of the cut-ins: lead speed [m/s] and range [m]."""
        return self.config["vehicle"]["name"], self.config.get("filters", {})

    @property
    def premises(self) -> dict[str, Any]:
        """Settings that the paper states, by the keys of `PREMISES`."""
        return {key: value_of(self.config, key) for key in PREMISES}

    @property
    def search(self) -> dict[str, Any]:
        """Settings of the searches by the Cross-Entropy method, and its constants."""
        return CONSTANTS | self.config["cross_entropy"]

    @property
    def segments(self) -> tuple[str, ...]:
        """Names of the segments, in order of lead speed."""
        return self.piecewise.segments

    @property
    def first_segment(self) -> str:
        """Name of the slowest segment, in which nearly all crashes happen."""
        return self.segments[0]

    @property
    def paper_interval(self) -> tuple[float, float] | None:
        """The paper's interval of the crash probability of a cut-in (section VI.C); None if there is none.

        The paper has none for other scenarios, and none for a vehicle without a crash map.
        """
        return PAPER_INTERVAL if self.has("exact") else None

    # The records.

    @cached_property
    def encounters(self) -> pd.DataFrame:
        """The checked encounter table, a row for each lane change."""
        path = self.path("encounters.parquet")
        return (read_encounters if self.scenario.has_support else pd.read_parquet)(path)

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

    # The laws of cut-ins: R^-1 with two or three pieces, one parametric law, and that of the largest weight.

    two_pieces = _law("models/two_pieces.json")
    three_pieces = _law("models/three_pieces.json")
    single = _law("models/single.json")
    answer_law = _law("laws/answer.json")

    @property
    def models(self) -> dict[str, IndependentLaw]:
        """All fitted laws by name."""
        return {"two_pieces": self.two_pieces, "three_pieces": self.three_pieces, "single": self.single}

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
        from accelerated_evaluation.methods.cross_entropy.search import read_proposals

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
