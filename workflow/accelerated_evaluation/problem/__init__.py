"""Problems for estimators: the probability of an event for a law and a vehicle, or for any system."""

from accelerated_evaluation.problem.cut_in import Problem, Sample, loaded_problem
from accelerated_evaluation.problem.scenario import ScenarioProblem, read_scenario_law

__all__ = [
    "Problem",
    "Sample",
    "ScenarioProblem",
    "loaded_problem",
    "read_scenario_law",
]
