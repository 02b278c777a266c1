"""What is asked of an estimate, by a call of the library or by options of the command ``estimate``."""

from collections.abc import Sequence
from dataclasses import dataclass

from accelerated_evaluation.base.arguments import a_number
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.options import option, positive_integer, read_from

ANSWER = "answer"  # the law that is the mixture of all laws that the records support
SHARE = 0.05  # allowed relative increase of the width of the interval by the sampling
A_SPEED = read_from(a_number(1, 200))
A_SHARE = read_from(a_number(0, 1))


@checked(replicates=a_number(1, whole=True), sampling_share=a_number(0), host_speed_max=a_number(1, 200))
@dataclass(frozen=True)
class Request:
    """What is asked of an estimate, in addition to its configuration; see the command ``estimate``.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> request = ae.Request(law="independent_variables", event="impact_speed=5")
    """

    law: str = option("LAW", "law of the encounters, see --help (default: %(default)s)", ANSWER)
    replicates: int = option(
        "N",
        "independent repetitions, of 100 to 300 simulations each (default: %(default)s)",
        1,
        type=positive_integer,
    )
    sampling_share: float = option(
        "SHARE",
        "stop when the sampling increases the width of the 80 %% interval by at most this share; with 0, "
        "only the paper's stopping rule is used (default: %(default)s)",
        SHARE,
        type=A_SHARE,
    )
    event: str | None = option(
        "EVENT",
        "event for which the simulations are chosen: crash, impact_speed=MIN_M_S and, for cut-ins, "
        "min_range=MAX_M or min_ttc=MAX_S; simulations that are chosen for crashes give no estimate for near "
        "misses (default: scenario.event of the configuration, by default crash)",
    )
    against: str | None = option(
        "OLD",
        "another vehicle, which may be slow, such as the version before: the configuration that names it "
        "(OLD.yaml), a label of compared_vehicles, or a name; it is estimated first, and if the vehicles are "
        "similar, its runs show where to begin, which often saves simulations",
    )
    reference: Sequence[str] = option(
        "NAME",
        "vehicle that is fast to simulate, such as cc_human; the ratio to its crash probability is computed "
        "for each draw of the law from a crash map or many simulations, in some seconds",
        (),
    )
    criteria: Sequence[str] = option(
        "TEXT",
        "upper limit by which the answer is judged, such as '1e-7 per hour', '1e-9 per kilometre', "
        "'1e-6 per cut-in', '1e-8 MAIS3+ per hour' or '0.5 x counted'; may be given several times, in "
        "addition to the criteria of the configuration",
        (),
        flag="--criterion",
    )
    host_speed_max: float | None = option(
        "M_S",
        "largest speed of the vehicle at the beginning of an encounter [m/s]; encounters with a faster one "
        "do not happen to it (default: vehicle.host_speed_max of the configuration, by default no limit)",
        type=A_SPEED,
    )
