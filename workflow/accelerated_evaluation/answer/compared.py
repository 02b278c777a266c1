"""Compare two slow vehicles: the ratio of their crash probabilities under the same draws of the law."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from accelerated_evaluation.answer.averaged import posterior_of
from accelerated_evaluation.answer.reweighting import LEAST, NOISE, SampledPosterior
from accelerated_evaluation.answer.summary import RATIO
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.digests import file_digest
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.tables import read_csv, require_file

# Columns of draws.csv that are read, and those columns of tables that are texts.
DRAWS = ("law", "probability", "error", "shared_error", "own_error", "batches", "unseen_lapses")
TEXTS = ("law", "event", "converged")
CHANGE = "Name the folder results/STUDY/estimate of an estimate with the same records, seed and --law."


def compare(own: SampledPosterior, other: SampledPosterior) -> dict[str, float]:
    """Compare the crash probabilities of two vehicles under the same draws of the law.

    The sampling errors of the two estimates are independent. The ratio under a draw is therefore computed for
    all pairs of `NOISE` equally likely errors of each estimate. If a vehicle may lapse (rarely behave
    differently than in most runs of the same encounter), its probability can be larger by up to the bound
    ``unseen_lapses``. The upper end of the interval and the probability to be safer assume that the first
    vehicle reaches its bound, and the lower end that the second one does.

    Parameters
    ----------
    own, other
        Posteriors of the two vehicles, with the same K draws of the law.

    Returns
    -------
    dict
        ``ratio``, the median of own / other; ``ratio_low80`` and ``ratio_high80``, the ends of its 80 %
        interval; and ``safer``, the probability that the first vehicle crashes less often.
    """
    others = other.probabilities[:, None, None] / _noise(other)[:, None, :]
    ratios = own.probabilities[:, None, None] / _noise(own)[:, :, None] / others
    lowest, highest = ratios / (1 + other.unseen_lapses / others), ratios + own.unseen_lapses / others
    ends = np.median(ratios), np.quantile(lowest, 0.1), np.quantile(highest, 0.9)
    return dict(zip(RATIO, map(float, ends), strict=True)) | {"safer": float(np.mean(highest < 1))}


def _noise(posterior: SampledPosterior) -> Array:
    """Return the estimate divided by the true probability, for equally likely errors, shape (K, NOISE)."""
    t = stdtrit(posterior.batches - 1, (np.arange(NOISE) + 0.5) / NOISE)
    return np.maximum(1 + posterior.errors[:, None] * t, LEAST)


def compare_estimates(own: Path, others: list[Path]) -> pd.DataFrame:
    """Compare an estimate with other estimates, by the files that the command ``estimate`` wrote.

    Parameters
    ----------
    own, others
        Folders of the estimates. Of several replicates, the first is used.

    Returns
    -------
    pandas.DataFrame
        One row for each other estimate: its folder ``other``; the median ``ratio`` of the probabilities,
        first by other; the ends ``ratio_low80`` and ``ratio_high80`` of its 80 % interval; and ``safer``, the
        probability that the first vehicle has the smaller probability; and ``other_converged``, whether the
        other estimate has converged.

    Raises
    ------
    InputError
        If a folder has no draws or damaged ones, or has draws of another law or for another event.
    """
    rows = []
    for other in others:
        require_estimate(other)
        if file_digest(own / "law.json") != file_digest(other / "law.json"):
            raise _error(other, "draws of another law", "the same law.json")
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


def _first(path: Path, names: Sequence[str]) -> pd.DataFrame:
    """Return the first replicate of a table that ``estimate`` wrote; InputError if a cell is missing."""
    table = read_csv(path, {name: name for name in ("replicate", *names)})
    first = table[table["replicate"] == "0"].copy()
    for name in names:
        if name not in TEXTS:
            first[name] = pd.to_numeric(first[name], errors="coerce").replace([np.inf, -np.inf], np.nan)
    if first.empty or first[list(names)].isna().any(axis=None):
        raise _error(
            path, "no rows" if first.empty else "a cell that is missing or no number", "a whole table"
        )
    return first


def _error(path: Path, seen: str, expected: str) -> InputError:
    return InputError(str(path), seen=seen, expected=expected, change=CHANGE)
