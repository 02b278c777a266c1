"""Parameters of built-in vehicles and their checks, and the compilation of their simulations."""

import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import MISSING, dataclass, field, fields
from functools import partial
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple, TypeVar

import numba
import numpy as np

from accelerated_evaluation.base.arguments import WRONG, Argument, a_number
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.compiling import cached_njit
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.hints import by_hint
from accelerated_evaluation.scenarios.protocol import Scenario

LARGEST_MULTIPLE = 100  # largest value of a parameter as a multiple of its published value
# Smallest number of encounters for a thread, which take about 5 ms. For smaller slices, starting a further
# thread takes longer than it saves.
SLICE_FOR_A_THREAD = 16_384
compiled = cached_njit(error_model="numpy", nogil=True)
Numbers = TypeVar("Numbers", bound=NamedTuple)


def parameter_names(vehicle_class: type) -> list[str]:
    """Return the names of the parameters of a built-in vehicle: the init fields of its dataclass."""
    return [each.name for each in fields(vehicle_class) if each.init]


def required_names(vehicle_class: type) -> list[str]:
    """Return the names of the parameters of a built-in vehicle that have no default."""
    required = (each for each in fields(vehicle_class) if each.init and each.default is MISSING)
    return [each.name for each in required if each.default_factory is MISSING]


def at_least(least: float, default: float) -> Any:  # noqa: ANN401
    """Return a dataclass field for a parameter that must be at least a number, which is 0 in most cases.

    A parameter with a plain number as default must be positive.
    """
    return field(default=default, metadata={"least": least})


zero_or_more = partial(at_least, 0.0)


def check_parameters(vehicle: Any) -> None:  # noqa: ANN401
    """Raise InputError if a parameter of a vehicle, a dataclass, is not what its type hint states.

    Whole numbers must be 0 or more, and other numbers in their range (`a_parameter`).
    """
    for each in (own for own in fields(vehicle) if own.init):
        value, hint = getattr(vehicle, each.name, None), each.type
        argument = a_number(0, whole=True) if hint is int else by_hint(hint)
        if hint in (float, float | None):
            argument = a_parameter(each.default, each.metadata.get("least"))
        if argument is None or (value is None and hint == float | None):
            continue
        try:
            argument.take(value)
        except WRONG as error:
            raise parameter_error(each.name, value, argument.in_words) from error


def a_parameter(published: object, least: float | None) -> Argument:
    """Return a parameter that is a number of at least ``least``, or above 0 for None.

    It must not exceed 100 times the published value, or 100 if that is 0 or unknown, because a larger one is
    a slip: such a car is not what its user thinks, and its simulation may overflow.
    """
    usual = published if isinstance(published, int | float) else 0.0
    largest = LARGEST_MULTIPLE * abs(usual or 1.0)
    words = "a positive number" if least is None else a_number(least).in_words

    def take(value: object) -> float:
        number = a_number(-largest, largest).take(value)
        if number < (least or 0.0) or (least is None and not number):
            raise ValueError
        return number

    multiple = f", {LARGEST_MULTIPLE} times the published {usual:g}" if usual else ""
    return Argument(f"{words}, and a size of at most {largest:g}{multiple}", take)


def parameter_error(name: str, value: object, expected: str) -> InputError:
    """Return the error for an invalid parameter of a built-in vehicle."""
    return InputError(
        f"vehicle parameter {name}",
        seen=repr(value),
        expected=expected,
        change=f"Set {name} in the vehicle's parameters, or leave it out for the published value.",
    )


def numbers_of(vehicle: object, kind: type[Numbers], **others: float) -> Numbers:
    """Return the parameters of a vehicle as a named tuple of floats and flags for compiled code.

    Fields that are not among the ``others`` are attributes of the vehicle with the same name, or keep their
    defaults.
    """
    same = {name: getattr(vehicle, name) for name in kind._fields if hasattr(vehicle, name)} | others
    own = {name: value if isinstance(value, bool) else float(value) for name, value in same.items()}
    return kind(**own)  # type: ignore[call-overload]  # the fields are those of the kind


@dataclass(frozen=True)
class AccAebParameters:
    """Parameters of a car with ACC, and with AEB unless ``aeb`` is false.

    The car has a proportional-integral ACC on the time headway, an AEB triggered by the time to collision
    (TTC), and an actuator limited in friction and jerk. The cars of the scenarios have other defaults and
    further parameters. InputError names the first parameter that is not a finite number in its range, which
    ends at 100 times its default.
    """

    deterministic: ClassVar[bool] = True
    published_ttc: ClassVar[tuple[float, float]]  # least and largest published threshold of the AEB [s]
    # The published threshold below the largest one: its value [s] at a speed [m/s], and its slope [s^2/m].
    published_line: ClassVar[tuple[float, float, float]]

    aeb: bool = True  # whether the car has AEB
    aeb_deceleration: float = 10.0  # largest deceleration that the AEB commands [m/s^2]
    aeb_jerk: float = 16.0  # rate at which this deceleration increases [m/s^3]
    # TTC at which the AEB switches on [s]; None for the published threshold, which depends on the speed.
    aeb_ttc: float | None = None
    aeb_release_ttc: float = 1.0  # TTC above which the AEB switches off again [s]
    headway: float = 2.0  # time headway that the ACC keeps [s]
    kp: float = at_least(
        -math.inf, -38.6252446973784
    )  # proportional gain of the ACC on the error of the time headway [m/s^3]
    ki: float = at_least(-math.inf, -1.35416845633818)  # integral gain [m/s^4]
    acc_limit: float = 5.0  # largest acceleration and deceleration that the ACC commands [m/s^2]
    acc_top_speed: float = 90 / 2.236  # at and above this speed [m/s] the ACC does not accelerate
    # Largest acceleration and deceleration that the friction of the road permits [m/s^2].
    friction_limit: float = 9.8
    actuator_jerk: float = 20.0  # rate at which the acceleration follows the command [m/s^3]

    def __post_init__(self) -> None:
        check_parameters(self)

    @property
    def threshold_top(self) -> float:
        """Largest TTC at which the AEB switches on [s]; 0 without AEB, because the TTC is always above 0."""
        if not self.aeb:
            return 0.0
        return self.published_ttc[1] if self.aeb_ttc is None else self.aeb_ttc

    def numbers(
        self, kind: type[Numbers], decision_step: float, motion_step: float, **others: float
    ) -> Numbers:
        """Return the parameters as a named tuple for compiled code; ``others`` belong to the scenario.

        ``decision_step`` [s] is that of the controller, and ``motion_step`` [s] that of the actuator.
        """
        value, speed, slope = self.published_line
        is_scaled = self.aeb and self.aeb_ttc is None
        return numbers_of(
            self,
            kind,
            ki_half_step=self.ki * decision_step / 2,
            threshold_base=value if is_scaled else self.threshold_top,
            threshold_slope=slope if is_scaled else 0.0,
            threshold_speed=speed,
            release_ttc=self.aeb_release_ttc,
            acceleration_step=self.actuator_jerk * motion_step,
            **others,
        )


def simulate_in_slices(
    scenario: Scenario,
    simulate_slice: Callable,
    encounters: Array,
    *numbers: Any,  # noqa: ANN401
    threads: int | None = None,
) -> Any:  # noqa: ANN401
    """Return the outcomes of n encounters, simulated in equal slices, one for each thread.

    Small batches use fewer threads than ``threads``. ``simulate_slice(encounters, begin, end, *numbers,
    outcomes)`` writes the outcomes of the encounters from ``begin`` to ``end`` to the same columns of
    ``outcomes``, and releases Python's global interpreter lock. The encounters are checked before, and the
    outcomes are those of the scenario.
    """
    n, threads = encounters.shape[1], available_threads() if threads is None else threads
    outcomes = np.empty((len(scenario.outcomes), n))
    parts = max(1, min(threads, n // SLICE_FOR_A_THREAD))
    cuts = np.linspace(0, n, parts + 1, dtype=int).tolist()
    if parts == 1:
        simulate_slice(encounters, 0, n, *numbers, outcomes)
    else:
        with ThreadPoolExecutor(parts) as pool:
            list(pool.map(lambda cut: simulate_slice(encounters, *cut, *numbers, outcomes), pairwise(cuts)))
    return scenario.outcomes_of(outcomes)


def available_threads() -> int:
    """Return the number of threads for a large batch.

    The number is that of the environment variable OMP_NUM_THREADS, which Snakemake sets to the number of
    threads of a rule. Without the variable, the number of cores is returned.
    """
    limit = os.environ.get("OMP_NUM_THREADS", "")
    return int(limit) if limit.isdigit() and int(limit) > 0 else vars(numba.config)["NUMBA_NUM_THREADS"]
