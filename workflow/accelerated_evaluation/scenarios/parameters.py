"""Parameters of built-in vehicles and their checks, and the compilation of their simulations."""

import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import MISSING, dataclass, field, fields
from itertools import pairwise
from typing import Any, ClassVar

import numba
import numpy as np

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.compiling import cached_njit
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.scenarios.protocol import Scenario

LARGEST_MULTIPLE = 100  # largest value of a parameter as a multiple of its published value
# Smallest number of encounters for a thread, which take about 5 ms. For smaller slices, starting a further
# thread takes longer than it saves.
SLICE_FOR_A_THREAD = 16_384
compiled = cached_njit(error_model="numpy", nogil=True)


def parameter_names(vehicle_class: type) -> list[str]:
    """Return the names of the parameters of a built-in vehicle: the init fields of its dataclass."""
    return [each.name for each in fields(vehicle_class) if each.init]


def required_names(vehicle_class: type) -> list[str]:
    """Return the names of the parameters of a built-in vehicle that have no default."""
    required = (each for each in fields(vehicle_class) if each.init and each.default is MISSING)
    return [each.name for each in required if each.default_factory is MISSING]


def zero_or_more(default: float) -> Any:  # noqa: ANN401
    """Return a dataclass field for a parameter that must be 0 or positive.

    A parameter with a plain number as default must be positive.
    """
    return field(default=default, metadata={"least": 0.0})


def check_number(
    name: str,
    value: Any,  # noqa: ANN401
    *,
    least: float | None = None,
    published: float | None = None,
) -> None:
    """Raise InputError if a parameter is not a finite number in its range.

    The number must be at least ``least``, or above 0 for None. It must not exceed 100 times the published
    value, or 100 if that is 0 or unknown, because a larger one is a slip: such a car is not what its user
    thinks, and its simulation may overflow.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not np.isfinite(value):
        raise parameter_error(name, value, "a finite number")
    if least is None and value <= 0:
        raise parameter_error(name, value, "a positive number")
    if least is not None and value < least:
        raise parameter_error(name, value, f"a number of {least:g} or more")
    largest = LARGEST_MULTIPLE * abs(published or 1.0)
    if abs(float(value)) > largest:
        usual = f", {LARGEST_MULTIPLE} times the published {published:g}" if published else ""
        raise parameter_error(name, value, f"a size of at most {largest:g}{usual}")


def parameter_error(name: str, value: object, expected: str) -> InputError:
    """Return the error for an invalid parameter of a built-in vehicle."""
    return InputError(
        f"vehicle parameter {name}",
        seen=repr(value),
        expected=expected,
        change=f"Set {name} in the vehicle's parameters, or leave it out for the published value.",
    )


@dataclass(frozen=True)
class AccAebParameters:
    """Parameters of a car with ACC, and with AEB unless ``aeb`` is false.

    The car has a proportional-integral ACC on the time headway, an AEB triggered by the time to collision
    (TTC), and an actuator limited in friction and jerk. The cars of the scenarios have other defaults and
    further parameters. InputError names the first parameter that is not a finite number in its range, which
    ends at 100 times its default.
    """

    deterministic: ClassVar[bool] = True

    aeb: bool = True  # whether the car has AEB
    aeb_deceleration: float = 10.0  # largest deceleration that the AEB commands [m/s^2]
    aeb_jerk: float = 16.0  # rate at which this deceleration increases [m/s^3]
    # TTC at which the AEB switches on [s]; None for the published threshold, which depends on the speed.
    aeb_ttc: float | None = None
    aeb_release_ttc: float = 1.0  # TTC above which the AEB switches off again [s]
    headway: float = 2.0  # time headway that the ACC keeps [s]
    kp: float = -38.6252446973784  # proportional gain of the ACC on the error of the time headway [m/s^3]
    ki: float = -1.35416845633818  # integral gain [m/s^4]
    acc_limit: float = 5.0  # largest acceleration and deceleration that the ACC commands [m/s^2]
    acc_top_speed: float = 90 / 2.236  # at and above this speed [m/s] the ACC does not accelerate
    # Largest acceleration and deceleration that the friction of the road permits [m/s^2].
    friction_limit: float = 9.8
    actuator_jerk: float = 20.0  # rate at which the acceleration follows the command [m/s^3]

    def __post_init__(self) -> None:
        if not isinstance(self.aeb, bool):
            raise parameter_error("aeb", self.aeb, "true or false")
        for each in fields(self):
            value = getattr(self, each.name)
            if each.type is float or (each.name == "aeb_ttc" and value is not None):
                least = -math.inf if each.name in ("kp", "ki") else None
                check_number(each.name, value, least=least, published=getattr(type(self), each.name))


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
