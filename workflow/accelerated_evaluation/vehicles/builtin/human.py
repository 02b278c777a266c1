"""A human driver from data: published response times, braking and swerving, different each time."""

import math
from dataclasses import dataclass, field, fields
from typing import ClassVar

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.scenarios.parameters import check_number, parameter_error, zero_or_more
from accelerated_evaluation.vehicles.builtin import human_kernel
from accelerated_evaluation.vehicles.builtin.human_numbers import SWERVE, HumanNumbers
from accelerated_evaluation.vehicles.builtin.human_population import Population
from accelerated_evaluation.vehicles.builtin.traces import trace_human
from accelerated_evaluation.vehicles.checks import checked_encounters
from accelerated_evaluation.vehicles.moving import checked_lead_speeds, checked_motion
from accelerated_evaluation.vehicles.protocol import Outcomes
from accelerated_evaluation.vehicles.registry import VEHICLES

URGENCY = 0.25  # [1/s], inverse time to collision of ``critical_response``


@VEHICLES.add("human")
@dataclass(frozen=True)
class Human:
    """A driver from a population of human drivers, each time another one.

    The driver responds to the other car's drift towards the lane, which may be noticed before the crossing.
    The response time is log-normal. Its mean falls with the urgency, the inverse time to collision at the
    crossing. The driver then brakes as hard as is needed to end the approach at a margin, but no harder than
    the largest deceleration that this driver uses, and the deceleration grows at a limited rate. Some drivers
    also swerve away. There is no crash if the bodies do not overlap sideways when the range becomes zero.

    Encounters begin at the crossing with the recorded range and closing speed. A driver who has begun to
    brake before the crossing brakes already there; the speed that was lost is contained in the record.
    Drivers who had responded early would seldom have reached a critical record. This selection is neglected,
    which makes the driver too safe if it responds before the crossing.

    `human_population` has the distributions of the traits with their sources, and the ranges of their
    uncertain parameters.

    Attributes
    ----------
    urgent_response
        Mean response time in the limit of great urgency [s]: .70 to .75 s for drivers who expect the signal
        (Green 2000, abstract).
    critical_response
        Mean response time at a time to collision of 4 s [s]: 1.0 to 1.3 (Summala 2000, abstract).
    calm_response
        Mean response time without urgency [s]: 1.25 for unexpected, common signals to 1.5 for surprise
        (Green 2000, abstract). Between these three values the mean is an exponential function of the inverse
        time to collision, which is an assumption.
    earliest_drift, latest_drift
        Lateral movement of the other car [m] between which drivers notice it: .375 m (UN R157, table of the
        driver model) to half a lane, which is the crossing itself. That all drivers notice it by then is an
        assumption.
    lane_width, car_width
        Width of the lane and of both cars [m], as those of the reference drivers.
    margin
        Range at which braking as hard as is needed ends the approach [m]: 2 m, as in FSM, but at most half of
        the initial range. An assumption.
    hard_braking
        Needed deceleration from which the driver brakes as hard as this driver ever does [m/s^2]: .32 g,
        which 95 % of the drivers exceed in emergency braking (Koppa, Fambro and Zimmer 1996, abstract). That
        drivers distinguish hard from other braking in this way is an assumption.
    delay
        Time [s] after which a driver who has responded sees a change of the lead speed. By default there is
        none, as for the reference drivers: a driver who watches the other car. An assumption, which only
        matters if the lead vehicle changes its speed. With the motion of NGSIM the crash probability of the
        default study is 1.4 times as large as with a constant lead speed; with a delay of .35 s it is 1.9
        times, and with .7 s 11 times as large (standard errors .05, .2 and 2).
    swerves
        If false, no driver swerves.
    certain
        If true, the population is the central one. By default each driver is from another population that the
        publications allow.
    seed
        Seed of the drivers, 0 or more.
    """

    deterministic: ClassVar[bool] = False

    urgent_response: float = 0.725
    critical_response: float = 1.15
    calm_response: float = 1.375
    earliest_drift: float = 0.375
    latest_drift: float = 1.75
    lane_width: float = 3.5
    car_width: float = 1.9
    margin: float = zero_or_more(2.0)
    hard_braking: float = 0.32 * 9.81
    delay: float = zero_or_more(0.0)
    swerves: bool = True
    certain: bool = False
    seed: int = 0
    _generator: np.random.Generator = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name, None)
            if each.name in ("swerves", "certain") and not isinstance(value, bool):
                raise parameter_error(each.name, value, "true or false")
            if each.init and each.name not in ("swerves", "certain", "seed"):
                check_number(each.name, value, least=each.metadata.get("least"))
        if isinstance(self.seed, bool) or not isinstance(self.seed, int) or self.seed < 0:
            raise parameter_error("seed", self.seed, "a whole number of 0 or more")
        if not self.urgent_response < self.critical_response < self.calm_response:
            expected = (
                f"between {self.urgent_response:g} and {self.calm_response:g} s, the other two responses"
            )
            raise parameter_error("critical_response", self.critical_response, expected)
        if not self.earliest_drift <= self.latest_drift <= self.lane_width / 2:
            expected = f"from earliest_drift, {self.earliest_drift:g} m, to half of lane_width"
            raise parameter_error("latest_drift", self.latest_drift, expected)
        object.__setattr__(self, "_generator", child_generator(self.seed, "human"))

    def simulate(self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike) -> Outcomes:
        """Simulate n cut-ins, each with another driver; see `simulate_given`."""
        encounters = checked_encounters(lead_speed, range_, closing_speed)
        return self._outcomes(encounters, self.draw_next(encounters.shape[1]))[0]

    def draw_inner(self, size: int, generator: np.random.Generator) -> Array:
        """Draw drivers: their traits, shape (size, traits), as `human_numbers` lists them."""
        population = Population.central(size) if self.certain else Population.draw(size, generator)
        traits = population.drivers(generator)
        if not self.swerves:
            traits[:, SWERVE] = 0.0
        return traits

    def inner_weights(self, inner: Array, draws: int, generator: np.random.Generator) -> Array:
        """Return the densities of drivers in possible populations, relative to the mean of all of these.

        Parameters
        ----------
        inner
            Traits of drivers, shape (drivers, traits).
        draws
            Number of possible populations.
        generator
            Source of the populations.

        Returns
        -------
        numpy.ndarray
            Shape (draws, drivers). The mean of the weights of each driver is 1.
        """
        if self.certain:
            return np.ones((draws, len(inner)))
        density = Population.draw(draws, generator).density(inner, swerves=self.swerves)
        mean = density.mean(axis=0)  # 0 for a driver whom none of few populations has
        return np.divide(density, mean, out=np.ones_like(density), where=mean > 0)

    def simulate_given(
        self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike, inner: Array
    ) -> Outcomes:
        """Simulate n cut-ins with given drivers.

        Parameters
        ----------
        lead_speed, range_, closing_speed
            As in `Vehicle.simulate`.
        inner
            Traits of the drivers, shape (n, traits).

        Returns
        -------
        Outcomes
            Of shape (n,). If a swerve avoids the crash, the smallest range is the last one before the bodies
            pass each other.

        Raises
        ------
        InputError
            If shapes differ or a value is out of its range; names the first such row, counted from 0.
        """
        return self._outcomes(checked_encounters(lead_speed, range_, closing_speed), inner)[0]

    def braking_given(
        self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike, inner: Array
    ) -> tuple[Outcomes, Array]:
        """Return what `simulate_given` returns, and the largest deceleration [m/s^2], shape (n,)."""
        return self._outcomes(checked_encounters(lead_speed, range_, closing_speed), inner)

    def simulate_moving(
        self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike, lead_speeds: ArrayLike
    ) -> Outcomes:
        """Simulate n cut-ins, each with another driver, behind lead vehicles that change their speeds.

        Parameters
        ----------
        lead_speed, range_, closing_speed
            As in `Vehicle.simulate`.
        lead_speeds
            Lead speeds [m/s] at 0, 0.1, ... s, shape (n, at least 81). The first ones are ``lead_speed``.

        Raises
        ------
        InputError
            As in `simulate_given`, and if lead speeds are not finite, negative, or too short in time.
        """
        drivers = self.draw_next(len(np.atleast_1d(lead_speed)))
        return self.simulate_moving_given(lead_speed, range_, closing_speed, lead_speeds, drivers)

    def simulate_moving_given(
        self,
        lead_speed: ArrayLike,
        range_: ArrayLike,
        closing_speed: ArrayLike,
        lead_speeds: ArrayLike,
        inner: Array,
    ) -> Outcomes:
        """Simulate n cut-ins with given drivers behind lead vehicles that change their speeds.

        The parameters are those of `simulate_moving`, and the traits of the drivers, shape (n, traits).
        """
        encounters = checked_encounters(lead_speed, range_, closing_speed)
        speeds = checked_lead_speeds(lead_speeds, encounters[0])
        return self._outcomes(encounters, inner, speeds)[0]

    def draw_next(self, size: int) -> Array:
        """Draw the next drivers of this object, shape (size, traits)."""
        return self.draw_inner(size, self._generator)

    def trace(
        self,
        lead_speed: float,
        range_: float,
        closing_speed: float,
        lead_speeds: ArrayLike | None = None,
    ) -> pd.DataFrame:
        """Return every state of one encounter with a newly drawn driver, as described in `traces`."""
        encounter = checked_encounters([lead_speed], [range_], [closing_speed])
        speeds = checked_motion(lead_speeds, encounter)
        return trace_human(self.compiled(), encounter, self.draw_next(1)[0], speeds)

    def compiled(self) -> HumanNumbers:
        """Return the numbers that the compiled code needs."""
        calm, critical = (
            response - self.urgent_response for response in (self.calm_response, self.critical_response)
        )
        shared = {name: float(getattr(self, name)) for name in HumanNumbers._fields if hasattr(self, name)}
        return HumanNumbers(urgency_slope=math.log(calm / critical) / URGENCY, **shared)

    def _outcomes(
        self, encounters: Array, inner: Array, lead_speeds: Array | None = None
    ) -> tuple[Outcomes, Array]:
        """Return the outcomes, and the largest decelerations [m/s^2]."""
        if inner.shape[0] != encounters.shape[1]:
            raise InputError(
                "drivers of the encounters",
                seen=f"{inner.shape[0]} drivers",
                expected=f"{encounters.shape[1]}, one for each encounter",
                change="Draw as many drivers as there are encounters.",
            )
        outcomes = np.empty((5, encounters.shape[1]))
        traits = np.ascontiguousarray(inner)
        if lead_speeds is None:
            human_kernel.follow_all(self.compiled(), encounters, traits, outcomes)
        else:
            human_kernel.follow_all_moving(self.compiled(), encounters, lead_speeds, traits, outcomes)
        return Outcomes(outcomes[0] > 0, *outcomes[1:4]), outcomes[4]
