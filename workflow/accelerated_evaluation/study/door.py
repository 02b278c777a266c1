"""The functions of the public interface that take a configuration, in any form in which a user has one."""

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from accelerated_evaluation.answer import estimation
from accelerated_evaluation.answer.candidates import fitted_records
from accelerated_evaluation.answer.candidates.fitted_records import FittedRecords
from accelerated_evaluation.answer.estimation import Estimated
from accelerated_evaluation.answer.settings import Settings, law_settings, limits_of, support_of
from accelerated_evaluation.answer.ways import choice as choices
from accelerated_evaluation.answer.ways.request import Request
from accelerated_evaluation.base.arguments import Argument, a_choice, one_of
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.laws.draws import Draws
from accelerated_evaluation.laws.limited import limited
from accelerated_evaluation.laws.paper.models import PAPER_LAWS, IndependentLaw
from accelerated_evaluation.records.checks import Records
from accelerated_evaluation.scenarios import DEFAULT, SCENARIOS
from accelerated_evaluation.scenarios.record_table import named_records_of
from accelerated_evaluation.study import configuration

Config = Mapping[str, Any]
"""A configuration. Callers may also give a file with one, or the name of a scenario."""


@checked()
def load(
    paths: str | os.PathLike | Sequence[str | os.PathLike] = (), given: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return the complete configuration of a study, with a value for each limit that is ``auto``.

    Parameters
    ----------
    paths
        A configuration file, or several, with the keys that differ from ``config/config.yaml``. A later file
        has precedence over an earlier one.
    given
        Further keys and values, which have precedence over all files.

    Returns
    -------
    dict
        The configuration. Limits that are ``auto`` are derived from the records.

    Raises
    ------
    StudyError
        If a file cannot be read, or the configuration is not valid.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> config = ae.load(given={"scenario": {"name": "left_turn"}, "seed": 7})
    >>> config["seed"], config["vehicle"]["name"]
    (7, 'acc_aeb')
    """
    paths = [paths] if isinstance(paths, str | os.PathLike) else paths
    return configuration.resolved(configuration.load(paths, given))


def _complete(config: Any) -> Mapping[str, Any]:  # noqa: ANN401
    if isinstance(config, str) and config in SCENARIOS:
        return load(given={"scenario": {"name": config}})
    if isinstance(config, str | os.PathLike):
        return load(config)
    if not isinstance(config, Mapping):
        raise TypeError
    is_complete = configuration.default_configuration().keys() <= config.keys()
    return configuration.resolved(config) if is_complete else load(given=config)


A_CONFIGURATION = Argument(
    lambda: f"a configuration, a file with one, or a scenario: {', '.join(sorted(SCENARIOS))}",
    _complete,
    "Make a configuration with load.",
)
RECORDS = one_of(FittedRecords, words="records", change="Read them with read_records.")


@checked(config=A_CONFIGURATION)
def read_records(config: Config, check: Callable[[Records], None] | None = None) -> FittedRecords:
    """Read the records of a scenario, and filter and segment cut-ins.

    Parameters
    ----------
    config
        A configuration from `load` or some of its keys, a configuration file, or the name of a scenario, for
        the records that come with the project.
    check
        Function that gets the records as the checks of records need them, and may raise an error.

    Returns
    -------
    FittedRecords
        The records to which laws are fitted. Those of cut-ins depend on the filters of the configuration, but
        not on the vehicle under test.

    Raises
    ------
    StudyError
        If the configuration is not valid, or the records cannot be used.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> records = ae.read_records("left_turn")
    >>> records.size, records.x.shape == (records.size, 3)
    (1028, True)
    """
    scenario = SCENARIOS[config["scenario"]["name"]]
    named, stream = named_records_of(scenario, config), child_generator(config["seed"], "sample")
    return fitted_records.records_of(scenario, named, stream, support_of(scenario, config), check)


@checked(records=RECORDS, config=A_CONFIGURATION)
def choose_draws(choice: str, records: FittedRecords, config: Config | None = None) -> Draws:
    """Return the draws of the law that a user names.

    Parameters
    ----------
    choice
        ``answer`` for all candidates by their weights; the name of one candidate, for draws of its
        parameters; a kind of law, or ``paper``, for one fitted law; or a law file, which ends in .json.
    records
        The records to which laws are fitted, or to which the law of a file belongs.
    config
        A configuration as in `read_records`, which gives the seed, the number of draws and limits of the
        encounters; by default that of the scenario.

    Returns
    -------
    Draws
        Draws of the law from its posterior, or one law.

    Raises
    ------
    InputError
        If there is no such law for these records.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> ae.choose_draws("independent_variables", ae.read_records("left_turn")).size
    1
    """
    config = config or _complete(records.scenario.name)
    settings, limits = law_settings(records.scenario, config), limits_of(records.scenario, config)
    return limited(choices.draws_named(choice, records, settings), limits, settings.streams("limits"))


@checked(
    name=a_choice(PAPER_LAWS),
    records=one_of(FittedRecords, words="records"),
    config=A_CONFIGURATION,
)
def fit_paper_law(name: str, records: FittedRecords, config: Config | None = None) -> IndependentLaw:
    """Fit one of the paper's laws to cut-ins.

    Parameters
    ----------
    name
        The number of pieces of the law: ``single``, ``two_pieces`` or ``three_pieces``.
    records
        Cut-ins, as `read_records` returns them.
    config
        A configuration as in `read_records`, which gives the settings of the models; by default that of
        cut-ins.

    Returns
    -------
    StratifiedLaw
        The law, with a stratum for each segment of the lead speed.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> config = ae.load(given={"data": {"sample": 2000, "spmd": {"outlier_rows": []}}})
    >>> law = ae.fit_paper_law("two_pieces", ae.read_records(config), config)
    >>> law.box.names
    ('lead_speed', 'range', 'closing_speed')
    """
    config = config or _complete(DEFAULT)
    return choices.paper_law_named(name, records.table, law_settings(records.scenario, config).fitting)


@checked(config=A_CONFIGURATION, request=one_of(Request, words="a request", change="Write Request(...)."))
def estimate(config: Config, request: Request = Request()) -> Estimated:  # noqa: B008
    """Estimate the probability of an event for the vehicle and the records of a configuration.

    This is the command ``estimate`` as a function.

    Parameters
    ----------
    config
        A configuration as in `read_records`.
    request
        What is asked in addition: the law, the event, references, criteria.

    Returns
    -------
    Estimated
        The answer, which writes its tables (`write`) and describes itself in words (`lines`).

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> found = ae.estimate("left_turn", ae.Request(law="independent_variables"))
    >>> found.answers[0].converged
    True
    """
    return estimation.estimate_event(Settings.of(config, request), request)
