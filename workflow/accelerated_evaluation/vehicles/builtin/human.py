"""A model of human drivers from published data: random response times, braking and swerving."""

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.randomness import child_generator
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.scenarios.parameters import (
    check_parameters,
    numbers_of,
    parameter_error,
    zero_or_more,
)
from accelerated_evaluation.vehicles.builtin import human_kernel
from accelerated_evaluation.vehicles.builtin.human_kernel import SWERVE, HumanNumbers
from accelerated_evaluation.vehicles.builtin.human_population import Population
from accelerated_evaluation.vehicles.builtin.traces import trace_human
from accelerated_evaluation.vehicles.moving import checked_lead_speeds, checked_motion, kept_speeds
from accelerated_evaluation.vehicles.protocol import VEHICLES, Outcomes

URGENCY = 0.25  # [1/s], inverse time to collision of ``critical_response``


@VEHICLES.add("human")
@dataclass(frozen=True)
class Human:
    """A random driver from a population of human drivers; each encounter has another driver.

    The driver responds to the other car's drift towards the lane, and may notice the drift before the other
    car crosses the lane marking (the crossing). The response time has a log-normal distribution, whose mean
    decreases with the urgency, the inverse time to collision at the crossing. The driver then brakes as hard
    as is needed to end the approach at a margin, but no harder than the largest deceleration that this driver
    uses, and the deceleration increases at a limited rate. Some drivers also swerve away. There is no crash
    if the cars do not overlap laterally when the range becomes zero.

    Encounters begin at the crossing with the recorded range and closing speed. A driver who has begun to
    brake before the crossing brakes at the start; the speed that was lost until then is contained in the
    record. Drivers who respond early rarely reach a critical range and closing speed at the crossing. This
    selection is neglected, which makes drivers who respond before the crossing too safe in the model.

    The distributions of the traits, their sources, and the ranges of uncertain parameters are in the module
    `human_population`.
    """

    deterministic: ClassVar[bool] = False

    # Mean response time in the limit of great urgency [s]: .70 to .75 s for drivers who expect the signal
    # (Green 2000, abstract).
    urgent_response: float = 0.725
    # Mean response time at a time to collision of 4 s [s]: 1.0 to 1.3 (Summala 2000, abstract).
    critical_response: float = 1.15
    # Mean response time without urgency [s]: 1.25 for unexpected, common signals to 1.5 for surprising events
    # (Green 2000, abstract). Between these three response times the mean is an exponential function of the
    # inverse time to collision, which is an assumption.
    calm_response: float = 1.375
    # Lateral movement of the other car at which drivers notice it at the earliest [m]: .375 m (UN R157, table
    # of the driver model).
    earliest_drift: float = 0.375
    # At the latest, half a lane [m], which is the crossing. It is an assumption that all drivers have noticed
    # it by then.
    latest_drift: float = 1.75
    lane_width: float = 3.5  # m, as for the reference drivers
    car_width: float = 1.9  # m, of both cars
    # Range at which the approach ends if the driver brakes as hard as is needed [m], but at most half of the
    # initial range. This is an assumption. FSM has a margin of 2 m. Here it is larger, because most
    # approaches end exactly at the margin, and the probability of an event such as "range at most 2 m" must
    # not depend on their last digits.
    margin: float = zero_or_more(2.5)
    # If the needed deceleration is at least this [m/s^2], the driver brakes with the largest deceleration
    # that this driver uses. The default is .32 g, which 95 % of the drivers exceed in emergency braking
    # (Koppa, Fambro and Zimmer 1996, abstract). It is an assumption that drivers distinguish hard from other
    # braking in this way.
    hard_braking: float = 0.32 * 9.81
    # Time after which a driver who has responded perceives a change of the lead speed [s]. By default it is
    # 0, as for the reference drivers, because the driver watches the other car. This is an assumption, which
    # matters only if the lead vehicle changes its speed. With the lead motion ``ngsim``, the crash
    # probability of the default study is 1.4 times as large as with a constant lead speed. With a delay of
    # 0.35 s it is 1.9 times as large, and with 0.7 s 11 times (standard errors 0.05, 0.2 and 2).
    delay: float = zero_or_more(0.0)
    swerves: bool = True  # whether some drivers swerve
    # Whether all drivers are from the population in the middle of the published ranges. By default each
    # driver is from another population within the ranges.
    certain: bool = False
    seed: int = 0  # seed of the drivers, 0 or more
    _generator: np.random.Generator = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_parameters(self)
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
        """Return the outcomes of n cut-ins, each simulated with a new random driver.

        The arguments are lead speed [m/s], range [m] and closing speed [m/s], each of shape (n,).
        """
        encounters = CUT_IN.checked(lead_speed, range_, closing_speed)
        return self._outcomes(encounters, self.draw_next(encounters.shape[1]))[0]

    def draw_inner(self, size: int, generator: np.random.Generator) -> Array:
        """Draw random drivers, and return their traits, shape (size, traits).

        The columns are the names in `human_kernel.TRAITS`.
        """
        population = Population.central(size) if self.certain else Population.draw(size, generator)
        traits = population.drivers(generator)
        if not self.swerves:
            traits[:, SWERVE] = 0.0
        return traits

    def inner_weights(self, inner: Array, draws: int, generator: np.random.Generator) -> Array:
        """Return the density of drivers in random populations, relative to its mean over populations.

        The relative densities are importance weights of the drivers, shape (draws, drivers), with a mean of 1
        for each driver; the traits ``inner`` have the shape (drivers, traits).
        """
        if self.certain:
            return np.ones((draws, len(inner)))
        density = Population.draw(draws, generator).density(inner, swerves=self.swerves)
        mean = density.mean(axis=0)  # 0 for a driver who is impossible in all populations that were drawn
        return np.divide(density, mean, out=np.ones_like(density), where=mean > 0)

    def simulate_given(
        self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike, inner: Array
    ) -> Outcomes:
        """Simulate n cut-ins with drivers of given traits, shape (n, traits).

        If a swerve avoids the crash, the smallest range is the last one before the cars pass each other.
        InputError names the first row, counted from 0, whose value is outside its limits.
        """
        return self._outcomes(CUT_IN.checked(lead_speed, range_, closing_speed), inner)[0]

    def braking_given(
        self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike, inner: Array
    ) -> tuple[Outcomes, Array]:
        """Return the outcomes of n cut-ins with given drivers, and the largest deceleration of each driver.

        The arguments are those of `simulate_given`. The decelerations [m/s^2] have shape (n,).
        """
        return self._outcomes(CUT_IN.checked(lead_speed, range_, closing_speed), inner)

    def simulate_moving(
        self, lead_speed: ArrayLike, range_: ArrayLike, closing_speed: ArrayLike, lead_speeds: ArrayLike
    ) -> Outcomes:
        """Simulate n cut-ins with random drivers and lead speeds [m/s] at 0, 0.1, ... s, (n, at least 81).

        The first column is ``lead_speed``. InputError is raised as in `simulate_given`, and if lead speeds
        are negative, not finite, or end before 8 s.
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
        """Return the outcomes of n cut-ins with given drivers behind lead vehicles that change their speeds.

        The arguments are lead speed [m/s], range [m] and closing speed [m/s] at the start, each of shape
        (n,); the lead speeds [m/s] at 0, 0.1, ... s, shape (n, at least 81); and the traits of the drivers
        (``inner``), shape (n, traits).
        """
        encounters = CUT_IN.checked(lead_speed, range_, closing_speed)
        speeds = checked_lead_speeds(lead_speeds, encounters[0])
        return self._outcomes(encounters, inner, speeds)[0]

    def draw_next(self, size: int) -> Array:
        """Return the traits, shape (size, traits), of drivers drawn with the generator of this object."""
        return self.draw_inner(size, self._generator)

    def trace(
        self,
        lead_speed: float,
        range_: float,
        closing_speed: float,
        lead_speeds: ArrayLike | None = None,
    ) -> pd.DataFrame:
        """Simulate one encounter with a new random driver, and return its states over time.

        The arguments are lead speed [m/s], range [m] and closing speed [m/s] at the start, and lead speeds
        [m/s] every 0.1 s, shape (states,), if the lead vehicle changes its speed. The table has one row for
        each state.
        """
        encounter = CUT_IN.checked([lead_speed], [range_], [closing_speed])
        speeds = checked_motion(lead_speeds, encounter)
        return trace_human(self.compiled(), encounter, self.draw_next(1)[0], speeds)

    def compiled(self) -> HumanNumbers:
        """Return the parameters of the vehicle as numbers for the compiled simulation."""
        calm, critical = (
            response - self.urgent_response for response in (self.calm_response, self.critical_response)
        )
        return numbers_of(self, HumanNumbers, urgency_slope=math.log(calm / critical) / URGENCY)

    def _outcomes(
        self, encounters: Array, inner: Array, lead_speeds: Array | None = None
    ) -> tuple[Outcomes, Array]:
        """Return the outcomes, and the largest decelerations [m/s^2], of encounters, shape (3, n)."""
        if inner.shape[0] != encounters.shape[1]:
            raise InputError(
                "drivers of the encounters",
                seen=f"{inner.shape[0]} drivers",
                expected=f"{encounters.shape[1]}, one for each encounter",
                change="Draw as many drivers as there are encounters.",
            )
        outcomes = np.empty((5, encounters.shape[1]))
        speeds = kept_speeds(encounters) if lead_speeds is None else lead_speeds
        human_kernel.follow_all(self.compiled(), encounters, speeds, np.ascontiguousarray(inner), outcomes)
        return Outcomes(outcomes[0] > 0, *outcomes[1:4]), outcomes[4]
