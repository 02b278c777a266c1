"""The law of cut-ins that a user names: fitted to the records, or read from the file of a finished study."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from accelerated_evaluation.answer.family_file import fit_or_read
from accelerated_evaluation.answer.scored_family import ScoredFamily, score_family
from accelerated_evaluation.answer.weighted_family import WeightedLaws
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws import FITS, Law
from accelerated_evaluation.laws.files import read_law
from accelerated_evaluation.laws.paper.independent import IndependentLaw
from accelerated_evaluation.laws.paper.models import PAPER_LAWS, fit_paper_laws
from accelerated_evaluation.laws.smooth.dependent import DependentLaw
from accelerated_evaluation.laws.smooth.draws import LawDraws
from accelerated_evaluation.laws.smooth.family import MEMBERS, DistinctRecords, Fitter, LawFamily, Member
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.records.sources import describe

ANSWER, PAPER = "answer", "paper"
SMOOTH = {member.name: member for member in MEMBERS}
FILE = ".json"


def fit_paper_law(name: str, encounters: pd.DataFrame, config: Mapping[str, Any]) -> IndependentLaw:
    """Fit the paper's laws to encounters, and return one of them.

    Parameters
    ----------
    name
        Name of the law in `PAPER_LAWS`.
    encounters
        Encounter table, with one row for each recorded cut-in.
    config
        A complete, valid configuration.

    Returns
    -------
    IndependentLaw
        The fitted law: range and time to collision are independent within each segment of lead speed.
    """
    models = config["models"]
    limits = config["filters"]["range_max"], describe(config["data"]), models["closing_speed_max"]
    return fit_paper_laws(encounters, models, *limits)[name]


for _name in PAPER_LAWS:
    FITS.add(_name)(partial(fit_paper_law, _name))


def require_law(choice: str) -> None:
    """Raise InputError unless ``choice`` is the name of a known law or the path of an existing law file."""
    if choice.endswith(FILE):
        if not Path(choice).is_file():
            change = "Correct the path."
            raise InputError("--law", seen=f"no file {choice}", expected="a law file", change=change)
    elif choice not in (ANSWER, PAPER, *FITS, *SMOOTH):
        raise InputError(
            "--law",
            seen=repr(choice),
            expected=f"{ANSWER}, {PAPER}, {', '.join(FITS)}, a law of the family ({', '.join(SMOOTH)}), "
            f"or a law file, which ends in {FILE}",
            change="Correct the name.",
        )


def choose_law(choice: str, encounters: pd.DataFrame, config: Mapping[str, Any]) -> tuple[str, Law]:
    """Return the law that a user has chosen, and its name.

    Parameters
    ----------
    choice
        One of these: ``answer``, the law with the largest weight among the smooth laws with dependence, which
        are fitted and weighted as in the study (``laws/answer.json``); ``paper``, the paper's law that the
        configuration names; the name of any law of these two kinds; or the path of a law file, which ends in
        ``.json``, with a law that was fitted to the same encounters.
    encounters
        Encounter table, with one row for each recorded cut-in.
    config
        A complete, valid configuration.

    Raises
    ------
    InputError
        If the name is unknown, if the law of the file was fitted to other encounters, or if there are too few
        records for the law.
    """
    require_law(choice)
    if choice.endswith(FILE):
        law = read_law(choice, encounters)
        return choice, law
    if choice == ANSWER or choice in SMOOTH:
        with threadpool_limits(1, "blas"):  # as in the jobs of the study, so that the digits are the same
            law = _smooth(choice, encounters, config)
        return law.description, law
    name = config["models"]["inverse_range"]["variant"] if choice == PAPER else choice
    return name, FITS[name](encounters, config)


def choose_sampled_law(choice: str, encounters: pd.DataFrame, config: Mapping[str, Any]) -> tuple[str, Law]:
    """Return the law under which a slow vehicle is simulated, and its name.

    Parameters
    ----------
    choice
        ``answer``, the name of a law, or the path of a law file. For ``answer`` the result is the mean of
        draws from the posterior of the laws and of their parameters. For a single smooth law with dependence
        it is the mean of draws of its parameters. Any other law is returned unchanged, because its
        uncertainty is not known.
    encounters
        Encounter table, with one row for each recorded cut-in.
    config
        A complete, valid configuration.

    Raises
    ------
    InputError
        If the name is unknown, if the law of the file was fitted to other encounters, or if there are too few
        records for the law.
    """
    require_law(choice)
    if choice != ANSWER and choice not in SMOOTH:
        return choose_law(choice, encounters, config)
    count, closing_speed_max = config["answer"]["draws"], config["answer"]["grid"]["closing_speed_max"]
    seed, records = config["seed"], DistinctRecords.of(encounters, Support.configured(config))
    with threadpool_limits(1, "blas"):
        if choice == ANSWER:
            # The fit of all laws is read from the file of the study, or written to it, so it is made once.
            scored = fit_or_read(Path("results", config["study"], "laws", "family.npz"), records)
            law = mean_law(scored, encounters, count, seed, closing_speed_max)
        else:
            fitted = _family(choice, records), [SMOOTH[choice]], np.ones((count, 1)), records.support
            law = _mean_of_draws(fitted, choice, encounters, seed, closing_speed_max)
    return law.description, law


def mean_law(
    scored: ScoredFamily, encounters: pd.DataFrame, count: int, seed: int, closing_speed_max: float
) -> MeanLaw:
    """Return the mean of many draws of the law, from the posterior of the laws and of their parameters.

    Parameters
    ----------
    scored
        The fit of all laws to the distinct encounters.
    encounters
        Encounter table, with one row for each recorded cut-in.
    count
        Number of draws.
    seed
        Root seed of the study.
    closing_speed_max
        Largest simulated closing speed [m/s]; cut-ins with a larger one are simulated with this speed.
    """
    weighted = WeightedLaws.drawn(scored, child_generator(seed, "laws", "weigh"), count)
    fitted = weighted.family, weighted.members, weighted.weights, scored.records.support
    return _mean_of_draws(fitted, "all laws", encounters, seed, closing_speed_max)


def _mean_of_draws(
    fitted: tuple[LawFamily, Sequence[Member], Array, Support],
    name: str,
    encounters: pd.DataFrame,
    seed: int,
    closing_speed_max: float,
) -> MeanLaw:
    """Return the mean of draws of a fitted family, given as the first arguments of `LawDraws.of`."""
    draws = LawDraws.of(*fitted, child_generator(seed, "laws", "draws"))
    return MeanLaw.fitted(draws, encounters, f"mean of {draws.size} draws of {name}", closing_speed_max)


def _smooth(choice: str, encounters: pd.DataFrame, config: Mapping[str, Any]) -> DependentLaw:
    """Fit one law with dependence, or all laws to find the one with the largest weight."""
    records = DistinctRecords.of(encounters, Support.configured(config))
    if choice == ANSWER:
        generator = child_generator(config["seed"], "laws", "weigh")
        weighted = WeightedLaws.drawn(score_family(records), generator, config["answer"]["draws"])
        return DependentLaw.fitted(weighted.family, weighted.heaviest, encounters, records.support)
    return DependentLaw.fitted(_family(choice, records), SMOOTH[choice], encounters, records.support)


def _family(choice: str, records: DistinctRecords) -> LawFamily:
    """Fit one law of the family."""
    size, family = records.size, Fitter(records, tuple(dict.fromkeys((Member(), SMOOTH[choice])))).fit()
    if SMOOTH[choice].level is not None and SMOOTH[choice] not in family.tails:
        raise InputError(
            "--law",
            seen=f"{choice!r}, whose threshold fewer than ten of the {size:,} distinct records exceed",
            expected="a law with a threshold that at least ten records exceed",
            change=f"Choose a law with a lower threshold, or {ANSWER}.",
        )
    return family
