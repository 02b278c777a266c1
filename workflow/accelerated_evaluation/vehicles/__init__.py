"""The vehicles under test: one protocol, the study's car, the reference drivers, and users' own."""

from accelerated_evaluation.vehicles.acc_aeb import AccAeb
from accelerated_evaluation.vehicles.built_in import VEHICLES
from accelerated_evaluation.vehicles.loading import load_vehicle
from accelerated_evaluation.vehicles.protocol import Outcomes, Vehicle

__all__ = ["VEHICLES", "AccAeb", "Outcomes", "Vehicle", "load_vehicle"]
