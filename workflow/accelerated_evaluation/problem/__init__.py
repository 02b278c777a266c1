"""Problems for estimators: the probability of an event for a law and a vehicle, or for any system."""

from accelerated_evaluation.problem.cut_in import Problem, Sample, loaded_problem
from accelerated_evaluation.problem.protocol import Response, ScoreProblem, SystemProblem
from accelerated_evaluation.problem.scenario import ScenarioProblem, read_scenario_law

__all__ = [
    "Problem",
    "Response",
    "Sample",
    "ScenarioProblem",
    "ScoreProblem",
    "SystemProblem",
    "loaded_problem",
    "read_scenario_law",
]
