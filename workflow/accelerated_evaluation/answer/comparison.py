"""Comparison of vehicles under the same draws of the law.

The ratio of two crash probabilities is computed for each draw. Uncertainty about the law that affects both
vehicles in the same way therefore cancels.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from accelerated_evaluation.answer.answer import Answer
from accelerated_evaluation.answer.posterior import SUMMARY, Posterior, SampledPosterior, answer_row
from accelerated_evaluation.base.digests import file_digest
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.tables import require_file

RATIO = ("ratio", "ratio_low80", "ratio_high80")
SAFER = "safer"
CHANGE = "Name the folder results/STUDY/estimate of an estimate with the same records, seed and --law."


def compare(own: Posterior | None, other: Posterior | None) -> dict[str, float]:
    """Return the ratio of two probabilities under the same draws, and the probability that it is below 1.

    The keys are ``ratio`` (median), ``ratio_low80`` and ``ratio_high80`` (80 % interval) and ``safer``. The
    sampling errors of the two are independent. All are NaN if there is no estimate, or if the other event
    never happens.
    """
    if own is None or other is None or not np.all(other.probabilities > 0):
        return dict.fromkeys((*RATIO, SAFER), np.nan)
    others = other.probabilities[:, None, None] / other.noise[:, None, :]
    ratios = own.probabilities[:, None, None] / own.noise[:, :, None] / others
    lowest, highest = ratios / (1 + other.unseen_lapses / others), ratios + own.unseen_lapses / others
    ends = np.median(ratios), np.quantile(lowest, 0.1), np.quantile(highest, 0.9)
    return dict(zip(RATIO, map(float, ends), strict=True)) | {SAFER: float(np.mean(highest < 1))}


def vehicle_table(answers: Mapping[str, Answer], references: Mapping[str, str]) -> pd.DataFrame:
    """Return one row for each vehicle: its replayed records, its answer, and its ratios to references.

    ``references`` names the reference vehicles by the prefix of their columns. A vehicle whose replayed
    records contradict its answer is not ``resolved``, and has no numbers.
    """
    resolved = {name: is_resolved(answer) for name, answer in answers.items()}
    rows = []
    for name, own in answers.items():
        replayed, known = own.replayed, resolved[name]
        row = {"vehicle": name, "recorded": None, "expected": np.nan, "resolved": known}
        if replayed is not None and own.posterior is not None:
            expected = replayed.records * own.posterior.probabilities.mean()
            row |= {"recorded": replayed.events, "expected": expected}
        row |= answer_row(own.posterior if known else None)
        for prefix, reference in references.items():
            other = answers[reference].posterior if resolved.get(reference, False) else None
            found = compare(own.posterior if known else None, other)
            row |= {f"{prefix}{column}": value for column, value in found.items()}
        rows.append(row | {"scan": own.notes.get("scan", "none")})
    ratios = [f"{prefix}{column}" for prefix in references for column in (*RATIO, SAFER)]
    columns = ["vehicle", "recorded", "expected", "resolved", *SUMMARY, *ratios, "scan"]
    return pd.DataFrame(rows, columns=columns)


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
    if isinstance(own, SampledPosterior):
        parts = {"error": own.errors, "shared_error": own.shared, "own_error": own.own}
        columns |= parts | {"batches": own.batches, "unseen_lapses": own.unseen_lapses}
    return pd.DataFrame(columns)


def posterior_of(table: pd.DataFrame) -> Posterior | None:
    """Return the posterior from the rows of `draws_table`; None if there are none."""
    if not len(table):
        return None
    probabilities = table["probability"].to_numpy(float)
    member = np.unique(table["law"], return_inverse=True)[1]
    if "error" not in table:
        return Posterior(probabilities, member)
    errors, own = (table[name].to_numpy(float) for name in ("error", "own_error"))
    shared, batches, unseen = (table[name].iloc[0] for name in ("shared_error", "batches", "unseen_lapses"))
    alone = None if np.isnan(shared) else own
    return SampledPosterior(probabilities, member, errors, int(batches), float(shared), alone, float(unseen))


def compare_estimates(own: Path, others: list[Path]) -> pd.DataFrame:
    """Compare the first replicates of estimates, given by their folders; one row for each other estimate."""
    rows = []
    for other in others:
        for name in ("law.json", "draws.csv", "answer.csv"):
            require_file(other / name, CHANGE)
        if file_digest(own / "law.json") != file_digest(other / "law.json"):
            seen, expected = "draws of another law", "the same law.json"
            raise InputError(str(other), seen=seen, expected=expected, change=CHANGE)
        events = [pd.read_csv(folder / "answer.csv")["event"].iloc[0] for folder in (own, other)]
        if events[0] != events[1]:
            raise InputError(str(other), seen=f"the event {events[1]}", expected=events[0], change=CHANGE)
        first = [posterior_of(_first(folder)) for folder in (own, other)]
        rows.append({"other": str(other)} | compare(*first))
    return pd.DataFrame(rows)


def _first(folder: Path) -> pd.DataFrame:
    draws = pd.read_csv(folder / "draws.csv")
    return draws[draws["replicate"] == 0]
