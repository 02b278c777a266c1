"""Tables of injuries: expected numbers of injured drivers, their uncertainty, and a comparison of vehicles.

The injuries of a cut-in are the expected number of injured drivers, at most one in each of the two cars. For
each level of injury, every curve for frontal impacts is combined with every curve for impacts from behind.
All combinations have the same weight, because the records contain no information about the publications.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import expit, ndtri

from accelerated_evaluation.answer.consequences.injuries.curves import FRONTAL, LEVELS, REAR, RiskCurve
from accelerated_evaluation.answer.consequences.injuries.sources import SOURCES, published_curves
from accelerated_evaluation.answer.consequences.rates import UNITS, Rate
from accelerated_evaluation.answer.ways.comparison import RATIO
from accelerated_evaluation.answer.ways.posterior import SUMMARY, Posterior, log_variances, shares, summarise
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.scenarios import OfScenarios

# 5 and 95 % of the cars sold in the United States in 2017 are lighter than this [lb] (Stolle and others 2020,
# Evaluation and update of MASH test vehicles, University of Nebraska-Lincoln).
MASSES = (2800, 5850)
NODES = 15  # number of nodes of the integral over the masses
SPEEDS = np.linspace(0, 80, 1601)  # [m/s], impact speeds at which risks are tabulated
GENTLE = 3.0  # [m/s], at smaller impact speeds hardly any car is towed, so the curves are extrapolated

Key = tuple[str, str, str]  # level of injury, struck end of the car, source of the curve
# Functions that return the risks of injury at `SPEEDS` in a crash, for the scenarios in which they are known.
RISKS: OfScenarios[Callable[[], dict[Key, Array]]] = OfScenarios("risks of injury", __name__, [])
PER_ENCOUNTER = "cut-in"
DISTANCES = 1e6  # rates are given per million kilometres or million hours
COLUMNS = ["vehicle", "level", "per", "mean", *SUMMARY[1:], "per_crash", "in_own_car", "gentle"]


@dataclass(frozen=True)
class MassRatio:
    """The distribution of the mass of the car that cuts in divided by the mass of the car under test.

    The ratio is lognormal. By default the masses of both cars are drawn independently from the same lognormal
    distribution.
    """

    mean: float = 0.0  # of the logarithm of the ratio
    # Of the logarithm of the ratio.
    deviation: float = float(np.sqrt(2) * np.log(MASSES[1] / MASSES[0]) / (2 * ndtri(0.95)))

    def expected_risk(self, curve: RiskCurve, impact: str, speed: Array) -> Array:
        """Return the risk of an injury at impact speeds [m/s], averaged over the masses, shape (n,).

        ``impact`` is the struck end of the car: `FRONTAL` for the car under test, `REAR` for the car that
        cuts in.
        """
        nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
        log_ratio = self.mean + self.deviation * nodes
        share = expit(log_ratio if impact == FRONTAL else -log_ratio)
        return curve(speed[:, None] * share) @ (weights / weights.sum())


def mean_risks(impact_speed: Array, tabulated: Mapping[Key, Array]) -> Array:
    """Return the mean of each tabulated risk over the crashes of each part, shape (curves, parts).

    The impact speeds [m/s] of a part are a row, shape (parts, points), with NaN where there is no crash. If
    none of the simulations of a part is a crash, the risk at an impact speed of 0 is used. It is also used
    for negative impact speeds, which occur in sideways contacts with a faster car.
    """
    crashed = ~np.isnan(impact_speed)
    speed, any_crash = np.where(crashed, impact_speed, 0.0), crashed.any(axis=1)
    counts, means = np.maximum(crashed.sum(axis=1), 1), []
    for risks in tabulated.values():
        total = np.where(crashed, np.interp(speed, SPEEDS, risks), 0.0).sum(axis=1)
        means.append(np.where(any_crash, total / counts, risks[0]))
    return np.array(means)


@RISKS.add("cut_in")
def tabulated_risks() -> dict[Key, Array]:
    """Return the risks of all published curves at `SPEEDS`, averaged over the masses of the cars.

    For each curve there is a second entry under the level ``gentle(level)``, whose risk is 0 at impact speeds
    of `GENTLE` or more. The keys are level of injury, struck end of the car and source of the curve. Both
    cars have the same distribution of the mass.
    """
    masses = MassRatio()
    risks = {
        (level, impact, source): masses.expected_risk(curve, impact, SPEEDS)
        for level in LEVELS
        for impact in (FRONTAL, REAR)
        for source, curve in published_curves(level, impact).items()
    }
    below = SPEEDS < GENTLE
    return risks | {
        (gentle(level), *rest): np.where(below, risk, 0.0) for (level, *rest), risk in risks.items()
    }


def gentle(level: str) -> str:
    """Return the name under which the risk of a level of injury in impacts below `GENTLE` is stored."""
    return f"{level}, gentle"


@dataclass(frozen=True)
class Injured:
    """Draws of the expected number of injured drivers in a cut-in, at one level of injury."""

    own: Array  # P(driver of the car under test is injured in a cut-in) by curve, (draws, curves)
    other: Array  # the same for the driver of the car that cuts in
    crash: Array  # draws of the crash probability, (draws,)
    member: NDArray[np.int_]  # index of the law of each draw, (draws,)
    # Names of the sources of the curves of `own` and of `other`.
    sources: tuple[Sequence[str], Sequence[str]]
    # Mean number of drivers in a cut-in who are injured in impacts below `GENTLE`.
    gentle: float = 0.0

    @classmethod
    def of(cls, posterior: Posterior, expected: Array, keys: Sequence[Key], level: str) -> "Injured":
        """Collect the draws of one level of injury from a posterior and expected risks, (draws, risks)."""

        def drawn(level: str, impact: str) -> tuple[Array, list[str]]:
            chosen = [i for i, (of, end, _) in enumerate(keys) if (of, end) == (level, impact)]
            return expected[:, chosen], [keys[i][2] for i in chosen]

        (own, first), (other, second) = (drawn(level, impact) for impact in (FRONTAL, REAR))
        slow = sum(float(drawn(gentle(level), impact)[0].mean()) for impact in (FRONTAL, REAR))
        return cls(own, other, posterior.probabilities, posterior.member, (first, second), slow)

    @cached_property
    def numbers(self) -> Array:
        """Expected number of injured drivers in a cut-in, shape (draws, combinations of two curves)."""
        return (self.own[:, :, None] + self.other[:, None, :]).reshape(len(self.own), -1)

    @property
    def combinations(self) -> list[tuple[str, str]]:
        """Names of the sources of the two curves of each combination."""
        own, other = self.sources
        return [(first, second) for first in own for second in other]

    @property
    def pooled(self) -> Posterior:
        """The draws of the number of injured drivers with all combinations of curves, as one posterior."""
        return Posterior(self.numbers.ravel(), np.repeat(self.member, self.numbers.shape[1]))

    def variances(self) -> dict[str, float]:
        """Return the variance of the logarithm of the number of injured drivers, by source.

        The sources are the data, the choice of law and the choice of curve.
        """
        columns = [Posterior(column, self.member) for column in self.numbers.T]
        parts = pd.DataFrame([log_variances(column) for column in columns]).mean(skipna=False).to_dict()
        known = not np.isnan(list(parts.values())).any()
        between = float(np.log(self.numbers).mean(axis=0).var()) if known else np.nan
        return parts | {"choice of curve": between}


def injuries_table(
    injured: Mapping[str, Mapping[str, Injured]], cut_ins: int, exposure: Mapping[str, float | None]
) -> pd.DataFrame:
    """Tabulate the injured drivers per cut-in, and per million kilometres and hours if these are known.

    Mean, median and interval ends include the uncertainty of the data, the choice of law and the choice of
    curve. ``per_crash`` is the expected number of injured drivers in a crash, ``in_own_car`` the share of the
    injured who drive the car under test, and ``gentle`` the share of those who are injured in impacts below
    `GENTLE`, where the curves are extrapolated.
    """
    rates = {f"million {key}": Rate(cut_ins, size) for key in UNITS if (size := exposure[key]) is not None}
    rows = []
    for vehicle, levels in injured.items():
        for level, found in levels.items():
            mean, crash = found.numbers.mean(), found.crash.mean()
            row = {"vehicle": vehicle, "level": level}
            row["per_crash"] = mean / crash if crash > 0 else np.nan
            row["in_own_car"] = found.own.mean() / mean if mean > 0 else np.nan
            row["gentle"] = found.gentle / mean if mean > 0 else np.nan
            summary = summarise(found.pooled)
            rows.append(row | summary | {"per": PER_ENCOUNTER, "mean": summary["probability"]})
            for per, rate in rates.items():
                summary = rate.summary(found.pooled)
                rows.append(row | {name: DISTANCES * value for name, value in summary.items()} | {"per": per})
    return pd.DataFrame(rows, columns=COLUMNS)


def balance_table(injured: Mapping[str, Mapping[str, Injured]], tested: str) -> pd.DataFrame:
    """Compare the injured drivers of the vehicle under test with those of each other vehicle.

    Both vehicles have the same draws of the law and the same curves, so most of the uncertainty cancels.
    ``ratio`` is the median of the ratio of injured drivers, with its 80 % interval, and ``fewer_injured`` the
    probability that there are fewer with the vehicle under test. A reference that never crashes has no row.
    """
    rows = []
    for reference in injured:
        if reference == tested or tested not in injured:
            continue
        for level, own in injured[tested].items():
            base = injured[reference][level].numbers
            if not (base > 0).all():
                continue
            ratio = own.numbers / base
            row = {"vehicle": tested, "reference": reference, "level": level}
            row |= dict(zip(RATIO, np.quantile(ratio, [0.5, 0.1, 0.9]).tolist(), strict=True))
            rows.append(row | {"fewer_injured": float(np.mean(ratio < 1))})
    return pd.DataFrame(rows, columns=["vehicle", "reference", "level", *RATIO, "fewer_injured"])


def injury_budget(injured: Mapping[str, Injured], sampling_deviation: float) -> pd.DataFrame:
    """Divide the variance of the logarithm of the injured drivers among its sources, for each level.

    The sources are the data, the choice of law, the choice of curve, and the sampling. ``sampling_deviation``
    is the relative standard deviation of an estimator of the crash probability. The last source is
    ``together``, and ``factor`` is exp(standard deviation of the logarithm).
    """
    sampling = float(np.log1p(sampling_deviation**2))
    parts = [
        shares(found.variances() | {"sampling": sampling}).assign(level=level)
        for level, found in injured.items()
    ]
    columns = ["level", "source", "factor", "variance_share"]
    return pd.concat(parts, ignore_index=True)[columns] if parts else pd.DataFrame(columns=columns)


def injuries_by_curve(injured: Mapping[str, Mapping[str, Injured]]) -> pd.DataFrame:
    """Tabulate the injured drivers per cut-in for each combination of two curves.

    ``frontal`` and ``rear`` are the sources of the curves of the two drivers. Mean, median and credible
    intervals are those over the draws of the law.
    """
    rows = [
        {"vehicle": vehicle, "level": level, FRONTAL: names[0], REAR: names[1]}
        | summarise(Posterior(column, found.member))
        for vehicle, levels in injured.items()
        for level, found in levels.items()
        for names, column in zip(found.combinations, found.numbers.T, strict=True)
    ]
    return pd.DataFrame(rows, columns=["vehicle", "level", FRONTAL, REAR, *SUMMARY])


def curves_table() -> pd.DataFrame:
    """Tabulate all published curves, with coefficients, population, reference, and how they were checked.

    There is one row for each curve: level of injury, struck end of the car, source, and the equation.
    """
    rows = [
        {
            "level": level,
            "impact": impact,
            "source": source.name,
            "curve": source.curves[level, impact].formula,
            "table": source.table,
            "population": source.population,
            "reference": source.reference,
            "doi": source.doi,
            "checked": source.checked,
        }
        for level in LEVELS
        for impact in (FRONTAL, REAR)
        for source in SOURCES.values()
        if (level, impact) in source.curves
    ]
    return pd.DataFrame(rows)


def injury_tables(
    posteriors: Mapping[str, tuple[Posterior, Array]],
    tested: str,
    keys: Sequence[Key],
    cut_ins: int,
    exposure: Mapping[str, float | None],
    sampling_deviation: float,
) -> dict[str, pd.DataFrame]:
    """Return the tables of injuries: numbers, comparison of vehicles, budget of the variance, and curves.

    ``posteriors`` has the crash probability and the expected risks of each vehicle; vehicles whose crash map
    was rejected are left out. The kilometres and hours of ``exposure`` are None if unknown.
    """
    injured = {
        name: {level: Injured.of(posterior, expected, keys, level) for level in LEVELS}
        for name, (posterior, expected) in posteriors.items()
    }
    return {
        "injuries": injuries_table(injured, cut_ins, exposure),
        "injuries_by_curve": injuries_by_curve(injured),
        "risk_balance": balance_table(injured, tested),
        "injury_budget": injury_budget(injured.get(tested, {}), sampling_deviation),
        "injury_curves": curves_table(),
    }
