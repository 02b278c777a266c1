"""Units of measurement: for each quantity, the factors that convert values to the SI unit."""

from collections.abc import Mapping

Units = Mapping[str, float]

SPEED: Units = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "ft/s": 0.3048}
LENGTH: Units = {"m": 1.0, "km": 1000.0, "ft": 0.3048}
INVERSE_LENGTH: Units = {"1/m": 1.0, "1/ft": 1 / 0.3048}
TIME: Units = {"s": 1.0, "ms": 0.001}
INVERSE_TIME: Units = {"1/s": 1.0}
ACCELERATION: Units = {"m/s^2": 1.0, "m/s2": 1.0, "ft/s^2": 0.3048, "g": 9.80665}
