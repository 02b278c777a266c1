"""Problems: a law of encounters, a vehicle and an event, in the form that methods of estimation need."""

from accelerated_evaluation.problem.problem import Problem, loaded_problem, read_law_of

__all__ = ["Problem", "loaded_problem", "read_law_of"]
