"""The law that a user names: all laws by their weights, one candidate, a kind of law, or a law file."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords
from accelerated_evaluation.answer.candidates.joint_family import Candidate
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily, named
from accelerated_evaluation.answer.ways.request import ANSWER
from accelerated_evaluation.base.arguments import one_of
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.users_code import call
from accelerated_evaluation.laws import FITS, LAWS, FitSettings, Law
from accelerated_evaluation.laws.draws import Draws, OneLaw, as_draws
from accelerated_evaluation.laws.joint import JointLaw
from accelerated_evaluation.laws.paper.models import PAPER_LAWS, IndependentLaw, fit_paper_laws
from accelerated_evaluation.laws.smooth.family import Fitter, Member
from accelerated_evaluation.methods.problem import read_law_of

PAPER = "paper"
FILE = ".json"
A_LAW = one_of(Law, words="a law", change="Correct this function.")


@dataclass(frozen=True)
class LawSettings:
    """How laws are fitted to records, weighted and drawn."""

    draws: int
    closing_speed_max: float  # cap on the closing speed of laws of cut-ins [m/s]
    store: Path  # file in which the fit of smooth laws is kept
    paper: str  # name of the paper's law that the study uses
    fitting: FitSettings  # of the laws in `FITS`
    streams: Callable[..., np.random.Generator]  # random generator of a step, as in the jobs of a study


def paper_law_named(name: str, encounters: pd.DataFrame, settings: FitSettings) -> IndependentLaw:
    """Fit the paper's laws to an encounter table, and return one by its name."""
    limits = settings.range_max, settings.description, settings.closing_speed_max
    return fit_paper_laws(encounters, settings.models, *limits)[name]


for _name in PAPER_LAWS:
    FITS.add(_name)(partial(paper_law_named, _name))


def draws_named(choice: str, records: FittedRecords, settings: LawSettings) -> Draws:
    """Return the draws of the law that a user names; see `study.door.choose_draws`."""
    generator = settings.streams("draws")
    if choice.endswith(FILE):
        if not Path(choice).is_file():
            change = "Correct the path."
            raise InputError("--law", seen=f"no file {choice}", expected="a law file", change=change)
        return as_draws(read_law_of(records.scenario, choice, records.table))
    if choice == ANSWER:
        # As in the jobs of the study: one thread, so that the digits are the same, and the file of its fit.
        own = settings.draws, settings.streams, settings.store, settings.closing_speed_max
        with threadpool_limits(1, "blas"):
            study = LawStudy.of(records, *own)
        return study.draws(generator)
    joint = [name for name, kind in LAWS.items() if issubclass(kind, JointLaw)]
    known = joint if records.in_clusters else (PAPER, *FITS, *named())
    if choice not in known:
        raise InputError(
            "--law",
            seen=repr(choice),
            expected=f"{ANSWER}, {', '.join(known)}, or a law file, which ends in {FILE}",
            change="Correct the name.",
        )
    if records.in_clusters:
        return OneLaw(Candidate(choice, LAWS[choice], {}).fit(records.data, settings.streams("fit", choice)))
    if choice in named():
        with threadpool_limits(1, "blas"):
            return _one_member(choice, records, settings.draws, settings.closing_speed_max).draws(generator)
    name = settings.paper if choice == PAPER else choice
    return OneLaw(call(FITS[name], records.table, settings.fitting, where=f"law {name}", returns=A_LAW))


def _one_member(name: str, records: FittedRecords, draws: int, closing_speed_max: float) -> LawStudy:
    """Fit one smooth law, without scores."""
    members = tuple(dict.fromkeys((Member(), named()[name])))
    fitter = Fitter(records.data, members)
    family = fitter.fit()
    if named()[name].level is not None and named()[name] not in family.tails:
        raise InputError(
            "--law",
            seen=f"{name!r}, whose threshold fewer than ten of the {records.size:,} distinct records exceed",
            expected="a law with a threshold that at least ten records exceed",
            change=f"Choose a law with a lower threshold, or {ANSWER}.",
        )
    scores = np.zeros((len(members), records.size))
    smooth = SmoothFamily(fitter, family, scores, {}, records.table, closing_speed_max)
    weights = np.zeros((draws, len(members)))
    weights[:, members.index(named()[name])] = 1.0
    return LawStudy(smooth, weights)
