"""The registry of the vehicles for cut-ins; a new vehicle is a module here that registers its class."""

from accelerated_evaluation.base.registry import Registry
from accelerated_evaluation.scenarios.cut_in import CUT_IN
from accelerated_evaluation.vehicles.protocol import Vehicle

VEHICLES: Registry[type[Vehicle]] = CUT_IN.vehicles
