"""Comparison of vehicles under the same draws of the law.

The ratio of two crash probabilities is computed for each draw. Uncertainty about the law that affects both
vehicles in the same way therefore cancels.
"""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.ways.answer import Answer
from accelerated_evaluation.answer.ways.posterior import CONTRADICTED, Posterior, SampledPosterior, answer_row
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.checking import checked

RATIO = ("ratio", "ratio_low80", "ratio_high80")
SAFER = "safer"


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
    >>> found = ae.evaluate(ae.Problem("left_turn", "acc_aeb"), draws, ae.Simulations(20_000), generator=1)
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
    own_unseen, other_unseen = (np.reshape(each.unseen_lapses, (-1, 1, 1)) for each in (own, other))
    middle = own.probabilities[:, None, None] / own.noise[:, :, None] / others
    return middle / (1 + other_unseen / others), middle, middle + own_unseen / others


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
    rows: pd.DataFrame,
    posteriors: Mapping[str, Posterior | None],
    references: Mapping[str, str],
    contradicted: Collection[str] = (),
) -> pd.DataFrame:
    """Return the rows of vehicles with their ratios to reference vehicles.

    ``posteriors`` has the crash probability of each vehicle, None if it is not known; ``references`` names
    the reference vehicles by the prefix of their columns. Counted crashes contradict the vehicles that are
    ``contradicted``.
    """
    table = rows.reset_index(drop=True)
    table[CONTRADICTED] = table["vehicle"].isin([*contradicted])
    for prefix, reference in references.items():
        found = [compare(posteriors[name], posteriors.get(reference)) for name in table["vehicle"]]
        for column in (*RATIO, SAFER):
            table[f"{prefix}{column}"] = [ratios[column] for ratios in found]
    return table[[*(name for name in table if name != "scan"), "scan"]]


def compared_table(
    posteriors: Mapping[str, Posterior | None], contradicted: Collection[str] = ()
) -> pd.DataFrame:
    """Return the ratio of the first vehicle's probability to that of each ``other``, with its interval.

    Counted crashes contradict the vehicles that are ``contradicted``.
    """
    (_, own), *others = posteriors.items()
    rows = [
        {"other": name} | compare(own, other) | {CONTRADICTED: name in contradicted} for name, other in others
    ]
    return pd.DataFrame(rows, columns=["other", *RATIO, SAFER, CONTRADICTED])


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
    errors, own, unseen = (table[name].to_numpy(float) for name in ("error", "own_error", "unseen_lapses"))
    shared, batches = (table[name].iloc[0] for name in ("shared_error", "batches"))
    alone = None if np.isnan(shared) else own
    return SampledPosterior(probabilities, member, errors, int(batches), float(shared), alone, unseen)
