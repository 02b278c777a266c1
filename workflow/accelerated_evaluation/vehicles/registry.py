"""The registry of the built-in vehicles: a new one is one module in this room that registers its class."""

from pathlib import Path

from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.vehicles.protocol import Vehicle

VEHICLES: Registry[type[Vehicle]] = Registry("vehicle", __package__, [str(Path(__file__).parent)])
