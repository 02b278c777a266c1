"""Distribution of excesses over a threshold, with a scale that depends smoothly on covariates.

The log scale is a penalised spline function of the covariates, and the shape is the same for all covariates
(Davison and Smith 1990 for the regression). The fit maximizes the penalised likelihood by Newton and Fisher
scoring steps. In units of its scale, every excess has the same distribution. The expected information of one
excess about its log scale and the shape is therefore the same small matrix for all excesses. It is computed
by quadrature, and the information about the spline coefficients follows from it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, solve_triangular

from accelerated_evaluation.base.arrays import Array, numbers_in
from accelerated_evaluation.base.errors import ConvergenceError
from accelerated_evaluation.laws.smooth.shapes import SHAPES, Shape
from accelerated_evaluation.laws.smooth.splines import Penalty

ITERATIONS = 300  # largest number of steps
# The iterations end if a step increases the log likelihood by less than TOLERANCE. The error of the
# parameters is then about a twentieth of their posterior standard deviation.
TOLERANCE = 3e-3
SMALLEST_STEP = 1e-5  # smallest factor of a step in the line search
DIFFERENCE = 1e-4  # difference of log scale and parameters, for numerical second derivatives
# Nodes (cumulative hazards) and weights of the quadrature for the expected information. The nodes reach far
# into the tail, which contains the information about the shape.
NODES = 40.0 * ((np.arange(200) + 0.5) / 200) ** 2
MASSES = np.exp(-NODES) * 2 * np.sqrt(NODES * 40.0) / 200


@dataclass(frozen=True)
class Excess:
    """A fitted distribution of excesses over a threshold."""

    shape: Shape
    coefficients: Array  # of the splines of the log scale, (p,)
    parameters: Array  # of the shape, (q,)
    smoothing: tuple[float, ...] = ()  # smoothing parameters of the log scale
    # Upper Cholesky factor of the penalised information of coefficients and parameters; None if the law was
    # read from a file.
    factor: Array | None = None

    def scale(self, covariates: Array) -> Array:
        """Return the scales, shape (n,), in the unit of the excess, given values of the splines, (n, p)."""
        return np.exp(covariates @ self.coefficients)

    def drawn(self, generator: np.random.Generator) -> "Excess":
        """Return the distribution with parameters drawn from their approximately normal posterior."""
        noise = solve_triangular(self.factor, generator.standard_normal(len(self.factor)))
        p = self.coefficients.size
        return replace(
            self, coefficients=self.coefficients + noise[:p], parameters=self.parameters + noise[p:]
        )

    def content(self) -> dict[str, Any]:
        """Return the content of the law file: name and parameters of the shape, and coefficients."""
        return {
            "shape": self.shape.name,
            "parameters": self.parameters.tolist(),
            "log_scale": self.coefficients.tolist(),
        }

    @classmethod
    def from_content(cls, content: Mapping[str, Any]) -> "Excess":
        """Build the distribution from the value that `content` returned."""
        coefficients, parameters = (numbers_in(content[name]) for name in ("log_scale", "parameters"))
        return cls(SHAPES[content["shape"]], coefficients, parameters)


def fit_excess(
    excess: Array,
    covariates: Array,
    penalty: Penalty,
    shape: Shape,
    *,
    start: Excess | None = None,
    gram: Array | None = None,
) -> Excess:
    """Fit the scale and the shape of n excesses, which are not negative, by penalised maximum likelihood.

    ``covariates`` are the values of the splines of the log scale, shape (n, p), whose rows sum to 1, and
    ``gram`` is their p x p product if it is known. An earlier fit as ``start`` supplies starting values and
    the smoothing parameters, which are otherwise estimated by marginal likelihood; it is returned unchanged
    if there are no excesses. ConvergenceError is raised if the iteration does not converge.
    """
    if start is not None and excess.size == 0:
        return start
    gram = covariates.T @ covariates if gram is None else gram
    problem, p = _Problem(excess, covariates, shape, gram), covariates.shape[1]
    if start is None:
        begin = np.concatenate([np.full(p, np.log(excess.mean())), shape.prior_mean])
    else:
        begin = np.concatenate([start.coefficients, start.parameters])
    known = None if start is None else start.smoothing
    values, factor, smoothing = penalty.maximised(problem.maximise, begin, known)
    return Excess(shape, values[:p], values[p:], smoothing, factor)


@dataclass(frozen=True)
class _Problem:
    """The penalised likelihood of excesses.

    It is a function of an array ``values`` with the coefficients of the log scale, followed by the parameters
    of the shape.
    """

    excess: Array
    covariates: Array
    shape: Shape
    gram: Array  # of the covariates

    @cached_property
    def _sums(self) -> Array:
        return self.covariates.sum(axis=0)

    def maximise(self, values: Array, precision: Array) -> tuple[Array, Array]:
        """Return the maximum of the penalised likelihood, found from the starting point ``values``.

        The second result is the Cholesky factor of the expected information there. ``precision`` is the
        precision matrix of the normal prior of the coefficients.
        """
        objective = self._objective(values, precision)
        for _ in range(ITERATIONS):
            gradient, expected = self._derivatives(values, precision)
            step = self._step(values, precision, gradient, expected)
            gain = float(step @ gradient)
            size, value = self._line_search(values, step, objective, precision)
            if gain < TOLERANCE or size == 0:
                return values, np.triu(cho_factor(expected)[0])
            values, objective = values + size * step, value
        change = "Choose a lower threshold or fewer splines."
        reached = f"a gain of {gain:.2g} in log likelihood"
        raise ConvergenceError("the excesses", reached=reached, limit=f"{TOLERANCE:g}", change=change)

    def _step(self, values: Array, precision: Array, gradient: Array, expected: Array) -> Array:
        """Return a Newton step, or a Fisher scoring step if the observed information is indefinite.

        Newton steps are preferred, because Fisher scoring steps are far too short if the likelihood is flat.
        An example are two kinds of drivers that hardly differ: the expected information is then larger than
        the curvature.
        """
        try:
            return cho_solve(cho_factor(self._information(self._observed(values), precision)), gradient)
        except LinAlgError:
            return cho_solve(cho_factor(expected), gradient)

    def _line_search(
        self, values: Array, step: Array, objective: float, precision: Array
    ) -> tuple[float, float]:
        """Return the factor by which the step is multiplied, and the objective after the multiplied step.

        The factor is 0 if no part of the step increases the objective.
        """
        size, best = 1.0, self._objective(values + step, precision)
        while best <= objective and size > SMALLEST_STEP:
            size /= 2
            best = self._objective(values + size * step, precision)
        if best <= objective:
            return 0.0, objective
        while size >= 1 and (value := self._objective(values + 2 * size * step, precision)) > best:
            size, best = 2 * size, value
        return size, best

    def _split(self, values: Array) -> tuple[Array, Array, Array]:
        p = self.covariates.shape[1]
        log_scale = self.covariates @ values[:p]
        return self.excess * np.exp(-log_scale), log_scale, values[p:]

    def _objective(self, values: Array, precision: Array) -> float:
        z, log_scale, parameters = self._split(values)
        p = self.covariates.shape[1]
        away = (parameters - self.shape.prior_mean) / self.shape.prior_deviation
        total = np.sum(self.shape.log_density(z, parameters) - log_scale)
        total -= (values[:p] @ precision @ values[:p] + away @ away) / 2
        return float(total) if np.isfinite(total) else -np.inf

    def _derivatives(self, values: Array, precision: Array) -> tuple[Array, Array]:
        z, _, parameters = self._split(values)
        p = self.covariates.shape[1]
        by_z, by_parameters = self.shape.derivatives(z, parameters)
        deviation = np.asarray(self.shape.prior_deviation)
        gradient = np.concatenate([self.covariates.T @ (-1 - z * by_z), by_parameters.sum(axis=0)])
        gradient[:p] -= precision @ values[:p]
        gradient[p:] -= (parameters - self.shape.prior_mean) / deviation**2
        return gradient, self._information(unit_information(self.shape, parameters), precision)

    def _information(self, each: Array, precision: Array) -> Array:
        """Return the information of all excesses plus the prior precision, given that of one excess."""
        p, q = self.covariates.shape[1], len(each) - 1
        information = np.zeros((p + q, p + q))
        information[:p, :p] = each[0, 0] * self.gram + precision
        information[:p, p:] = np.outer(self._sums, each[0, 1:])
        information[p:, :p] = information[:p, p:].T
        prior = np.diag(np.asarray(self.shape.prior_deviation) ** -2.0)
        information[p:, p:] = self.excess.size * each[1:, 1:] + prior
        return information

    def _observed(self, values: Array) -> Array:
        """Return the mean observed information of one excess, computed from differences of gradients."""
        z, _, parameters = self._split(values)

        def gradient(log_scale: float, parameters: Array) -> Array:
            scaled = z * np.exp(-log_scale)
            by_z, by_parameters = self.shape.derivatives(scaled, parameters)
            return np.array([np.mean(-1 - scaled * by_z), *by_parameters.mean(axis=0)])

        steps = DIFFERENCE * np.eye(1 + parameters.size)
        columns = [
            (gradient(-step[0], parameters - step[1:]) - gradient(step[0], parameters + step[1:]))
            / (2 * DIFFERENCE)
            for step in steps
        ]
        return (np.array(columns) + np.array(columns).T) / 2


def unit_information(shape: Shape, parameters: Array) -> Array:
    """Return the expected Fisher information of one excess about log scale and the q shape parameters.

    Its shape is (1 + q, 1 + q), with the log scale first.
    """
    z = shape.inverse(NODES, parameters)
    by_z, by_parameters = shape.derivatives(z, parameters)
    gradients = np.column_stack([-1 - z * by_z, by_parameters])
    return gradients.T @ (MASSES[:, None] * gradients) / MASSES.sum()
