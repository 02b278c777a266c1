"""The numbers of a human driver that go from its class to the compiled code."""

from typing import NamedTuple

# The traits of a driver: factor of the response time; share of the way from the earliest to the latest drift
# at which the driver notices the other car; duration of the other car's lane change [s]; largest deceleration
# that the driver uses [m/s^2]; its growth [m/s^3]; lateral acceleration of a swerve [m/s^2], 0 for a driver
# who does not swerve; width of the swerve [m].
TRAITS = RESPONSE, NOTICE, DURATION, BRAKING, JERK, SWERVE, SWERVE_WIDTH = range(7)


class HumanNumbers(NamedTuple):
    """The numbers that all drivers share, in SI units; `human.Human` says what they mean."""

    urgent_response: float
    calm_response: float
    urgency_slope: float
    earliest_drift: float
    latest_drift: float
    lane_width: float
    car_width: float
    margin: float
    hard_braking: float
    delay: float
