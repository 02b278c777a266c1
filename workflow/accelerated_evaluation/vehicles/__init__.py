"""The vehicles under test: the interface, the car of the study, reference drivers, and users' vehicles."""

from accelerated_evaluation.vehicles.builtin.acc_aeb import AccAeb
from accelerated_evaluation.vehicles.loading import load_vehicle
from accelerated_evaluation.vehicles.protocol import VEHICLES, Outcomes, Vehicle

__all__ = ["VEHICLES", "AccAeb", "Outcomes", "Vehicle", "load_vehicle"]
