"""Problems: a law of encounters, a vehicle and an event, in the form that methods of estimation need."""

from accelerated_evaluation.problem.problem import Problem, loaded_problem, read_law_of
from accelerated_evaluation.problem.protocol import Response, ScoreProblem, SystemProblem

__all__ = ["Problem", "Response", "ScoreProblem", "SystemProblem", "loaded_problem", "read_law_of"]
