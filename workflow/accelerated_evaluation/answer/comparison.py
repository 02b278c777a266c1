"""Comparison of vehicles under the same draws of the law.

The ratio of two crash probabilities is computed for each draw. Uncertainty about the law that affects both
vehicles in the same way therefore cancels.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.answer import Answer
from accelerated_evaluation.answer.posterior import Posterior, SampledPosterior, answer_row
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import read_json
from accelerated_evaluation.base.tables import read_csv, require_file
from accelerated_evaluation.laws.files import law_digest

RATIO = ("ratio", "ratio_low80", "ratio_high80")
SAFER = "safer"
# Columns of draws.csv that are read, and those columns of tables that are texts.
DRAWS = ("law", "probability", "error", "shared_error", "own_error", "batches", "unseen_lapses")
TEXTS = ("law", "event", "converged")
# Smallest and largest value of each column of numbers; the errors are relative ones.
LIMITS = {
    "probability": (0.0, 1.0),
    **dict.fromkeys(("error", "shared_error", "own_error"), (0.0, 1e3)),
    "batches": (1, 1e6),
    "unseen_lapses": (0.0, 1.0),
}
CHANGE = "Name the folder results/STUDY/estimate of an estimate with the same records, seed and --law."


@checked()
def compare(own: Posterior | None, other: Posterior | None) -> dict[str, float]:
    """Return the ratio of two probabilities under the same draws, and the probability that it is below 1.

    The keys are ``ratio`` (median), ``ratio_low80`` and ``ratio_high80`` (80 % interval) and ``safer``. The
    sampling errors of the two are independent. Draws in which one of them is unknown are left out. All are
    NaN if there is no estimate, if these are half of the draws, or if the other event never happens.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> draws = ae.choose_draws("independent_variables", ae.read_records("left_turn"))
    >>> problem = ae.Problem("left_turn", "acc_aeb")
    >>> found = ae.evaluate(problem, draws, ae.Simulations(20_000), generator=1)
    >>> ratio = ae.compare(found.posterior, found.posterior)
    >>> sorted(ratio)
    ['ratio', 'ratio_high80', 'ratio_low80', 'safer']
    """
    if own is None or other is None or not np.all((other.probabilities > 0) | other.unknown):
        return dict.fromkeys((*RATIO, SAFER), np.nan)
    known = ~np.broadcast_to(own.unknown | other.unknown, other.probabilities.shape)
    if np.mean(known) <= 0.5:
        return dict.fromkeys((*RATIO, SAFER), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):  # where both are unknown
        lowest, middle, highest = (each[known] for each in ratios(own, other))
    ends = np.median(middle), np.quantile(lowest, 0.1), np.quantile(highest, 0.9)
    return dict(zip(RATIO, map(float, ends), strict=True)) | {SAFER: float(np.mean(highest < 1))}


def ratios(own: Posterior, other: Posterior) -> tuple[Array, Array, Array]:
    """Return equally likely values of the ratio of two probabilities for each of K draws of the law.

    The three arrays of shape (K, values of own, values of other) are the ratio if unseen lapses add as much
    as they can to the second probability, the ratio without them, and the ratio if they add to the first one.
    """
    others = other.probabilities[:, None, None] / other.noise[:, None, :]
    middle = own.probabilities[:, None, None] / own.noise[:, :, None] / others
    return middle / (1 + other.unseen_lapses / others), middle, middle + own.unseen_lapses / others


def vehicle_row(name: str, own: Answer) -> dict[str, Any]:
    """Return the row of a vehicle in `vehicle_table` without its ratios.

    A vehicle whose replayed records contradict its answer is not ``resolved``, and has no numbers.
    """
    known = is_resolved(own)
    row = {"vehicle": name, "recorded": None, "expected": np.nan, "resolved": known}
    if (replayed := own.replayed) is not None and own.posterior is not None:
        expected = replayed.records * own.posterior.probabilities.mean()
        row |= {"recorded": replayed.events, "expected": expected}
    return row | answer_row(own.posterior if known else None) | {"scan": own.notes.get("scan", "none")}


def vehicle_table(
    rows: pd.DataFrame, posteriors: Mapping[str, Posterior | None], references: Mapping[str, str]
) -> pd.DataFrame:
    """Return the rows of vehicles with their ratios to reference vehicles.

    ``posteriors`` has the crash probability of each vehicle, None if it is not known; ``references`` names
    the reference vehicles by the prefix of their columns.
    """
    table = rows.reset_index(drop=True)
    for prefix, reference in references.items():
        found = [compare(posteriors[name], posteriors.get(reference)) for name in table["vehicle"]]
        for column in (*RATIO, SAFER):
            table[f"{prefix}{column}"] = [ratios[column] for ratios in found]
    return table[[*(name for name in table if name != "scan"), "scan"]]


def compared_table(posteriors: Mapping[str, Posterior | None]) -> pd.DataFrame:
    """Return the ratio of the first vehicle's probability to that of each ``other``, with its interval."""
    (_, own), *others = posteriors.items()
    rows = [{"other": name} | compare(own, other) for name, other in others]
    return pd.DataFrame(rows, columns=["other", *RATIO, SAFER])


def is_resolved(answer: Answer) -> bool:
    """Return whether the replayed records agree with an answer, or were not replayed."""
    own, replayed = answer.posterior, answer.replayed
    return own is None or replayed is None or replayed.supports(float(own.probabilities.mean()))


def draws_table(answer: Answer) -> pd.DataFrame:
    """Return one row for each draw of the law, from which `posterior_of` reads the posterior again."""
    own = answer.posterior
    columns = {"draw": np.arange(answer.draws.size) + 1, "law": answer.draws.names}
    if own is None:
        return pd.DataFrame(columns=[*columns, "probability"])
    columns["probability"] = own.probabilities
    if own.is_sampled:
        parts = {"error": own.errors, "shared_error": own.shared, "own_error": own.own}
        columns |= parts | {"batches": own.batches, "unseen_lapses": own.unseen_lapses}
        columns["simulations"] = answer.simulations
    return pd.DataFrame(columns)


def posterior_of(table: pd.DataFrame) -> Posterior | None:
    """Return the posterior from the rows of `draws_table`; None if there are none."""
    if not len(table):
        return None
    probabilities = table["probability"].to_numpy(float)
    member = np.unique(table["law"], return_inverse=True)[1]
    if "error" not in table or table["error"].isna().all():
        return Posterior(probabilities, member)
    errors, own = (table[name].to_numpy(float) for name in ("error", "own_error"))
    shared, batches, unseen = (table[name].iloc[0] for name in ("shared_error", "batches", "unseen_lapses"))
    alone = None if np.isnan(shared) else own
    return SampledPosterior(probabilities, member, errors, int(batches), float(shared), alone, float(unseen))


def compare_estimates(own: Path, others: list[Path]) -> pd.DataFrame:
    """Compare an estimate with other estimates, by the files that the command ``estimate`` wrote.

    There is a row for each other estimate. ``ratio`` is the median of the probabilities divided by those of
    the other estimate, with an 80 % interval, and ``safer`` is the probability that the first vehicle has the
    smaller one. Of several replicates, the first is used. InputError is raised if a folder has no draws or
    damaged ones, or has draws of another law or for another event.
    """
    rows, law = [], law_digest(read_json(own / "law.json"))
    for other in others:
        require_estimate(other)
        require_same_law(other, law)
        events = [_first(folder / "answer.csv", ("event",))["event"].iloc[0] for folder in (own, other)]
        if events[0] != events[1]:
            raise _error(other, f"the event {events[1]}", events[0])
        draws = [_first(folder / "draws.csv", DRAWS) for folder in (own, other)]
        if len(draws[0]) != len(draws[1]):
            raise _error(other / "draws.csv", f"{len(draws[1])} draws of the law", f"{len(draws[0])}")
        has_converged = _first(other / "estimate.csv", ("converged",))["converged"].iloc[0] == "True"
        ratio = compare(*map(posterior_of, draws))
        rows.append({"other": str(other), **ratio, "other_converged": has_converged})
    return pd.DataFrame(rows)


def require_estimate(folder: Path) -> None:
    """Raise InputError if a folder is not that of an estimate with draws of the law."""
    for name in ("law.json", "draws.csv", "answer.csv", "estimate.csv"):
        require_file(folder / name, CHANGE)
    _first(folder / "draws.csv", DRAWS)


def require_same_law(folder: Path, law: str) -> None:
    """Raise InputError if an estimate has draws of another law than that with the given digest."""
    if law_digest(read_json(folder / "law.json")) != law:
        raise _error(folder, "draws of another law", "the same law.json")


def _first(path: Path, names: Sequence[str]) -> pd.DataFrame:
    """Return the first replicate of a table that ``estimate`` wrote; InputError if a cell is impossible."""
    table = read_csv(path, {name: name for name in ("replicate", *names)})
    first = table[table["replicate"] == "0"].copy()
    for name in names:
        if name not in TEXTS:
            first[name] = pd.to_numeric(first[name], errors="coerce").replace([np.inf, -np.inf], np.nan)
    if first.empty or first[list(names)].isna().any(axis=None):
        raise _error(
            path, "no rows" if first.empty else "a cell that is missing or no number", "a whole table"
        )
    for name in LIMITS.keys() & set(names):
        low, high = LIMITS[name]
        wrong = (first[name] < low) | (first[name] > high)
        if wrong.any():
            where = f"row {wrong.idxmax() + 2}, column {name}"
            raise _error(path, f"{first.loc[wrong.idxmax(), name]:g} in {where}", f"{low:g} to {high:g}")
    return first


def _error(path: Path, seen: str, expected: str) -> InputError:
    return InputError(str(path), seen=seen, expected=expected, change=CHANGE)
