"""The car under test: one protocol, the compiled ACC + AEB car, users' own."""

from accelerated_evaluation.vehicles.acc_aeb import AccAeb
from accelerated_evaluation.vehicles.loading import load_vehicle
from accelerated_evaluation.vehicles.protocol import Outcomes, Vehicle

__all__ = ["AccAeb", "Outcomes", "Vehicle", "load_vehicle"]
