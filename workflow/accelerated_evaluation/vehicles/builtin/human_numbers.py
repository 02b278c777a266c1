"""The parameters of a human driver that are passed from its class to the compiled code."""

from typing import NamedTuple

# The traits of a driver, which differ from driver to driver:
# - RESPONSE: factor of the response time;
# - NOTICE: share of the way from the earliest to the latest drift at which the driver notices the other car;
# - DURATION: duration of the other car's lane change [s];
# - BRAKING, JERK: largest deceleration that the driver uses [m/s^2], and rate at which it increases [m/s^3];
# - SWERVE, SWERVE_WIDTH: lateral acceleration of a swerve [m/s^2], 0 for a driver who does not swerve, and
#   lateral displacement of the swerve [m].
TRAITS = RESPONSE, NOTICE, DURATION, BRAKING, JERK, SWERVE, SWERVE_WIDTH = range(7)


class HumanNumbers(NamedTuple):
    """The parameters that all drivers share, in SI units; they are explained in `human.Human`."""

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
