"""The sampler as a generator of gest-api, the standard of tools that run simulations, such as libEnsemble."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gest_api import Generator  # type: ignore[import-not-found]  # an extra
from gest_api.vocs import VOCS, GreaterThanConstraint, LessThanConstraint  # type: ignore[import-not-found]

from fewruns.errors import require
from fewruns.estimates import Estimate, Stopping
from fewruns.problems import Marginal, SystemProblem
from fewruns.running import GOAL
from fewruns.sampler import Sampler

KINDS = [LessThanConstraint], [GreaterThanConstraint]


class EventGenerator(Generator):
    """Points at which the probability is learnt that a constraint is violated.

    Parameters
    ----------
    vocs
        The names of the variables, whose bounds are not used, and one constraint LESS_THAN or GREATER_THAN.
        Runs without a value of the constraint, NaN, have failed.
    inputs
        The distributions of the variables, in their order.
    generator
        Source of all randomness.
    stopping
        The rule that ends the runs.
    **settings
        Further arguments of `Sampler`. sampler_reference.md has an example.
    """

    returns_id = True

    def __init__(
        self,
        vocs: VOCS,
        inputs: Sequence[Marginal],
        generator: np.random.Generator,
        stopping: Stopping = GOAL,
        **settings: Any,  # noqa: ANN401
    ) -> None:
        self._problem = SystemProblem(lambda x: (x[:, 0] > 0, None), len(inputs), inputs)
        super().__init__(vocs)
        ((self._name, self._constraint),) = vocs.constraints.items()
        self._vocs, self.stopping = vocs, stopping
        self.sampler = Sampler(len(inputs), generator, **settings)

    def _validate_vocs(self, vocs: VOCS) -> None:
        kinds = [type(constraint) for constraint in vocs.constraints.values()]
        fits = len(vocs.variables) == self._problem.dimension and kinds in KINDS
        expected = "a variable for each distribution, and one constraint LESS_THAN or GREATER_THAN"
        require("vocs", vocs, expected, fits=fits)

    def suggest(self, num_points: int | None = None) -> list[dict]:
        """Return so many points with numbers ``_id``, by default a batch; none if the runs have ended."""
        sampler, rule, count = self.sampler, self.stopping, num_points
        if sampler.is_done(rule) or count == 0:
            return []
        z = sampler.ask(count or sampler.batch_size, certify=sampler.is_narrow(rule), exactly=True)
        constants = {name: each.value for name, each in self._vocs.constants.items()}
        points = zip(sampler.numbers.tolist(), self._problem.inputs(z).tolist(), strict=True)
        names = self._vocs.variable_names
        return [{**dict(zip(names, x, strict=True)), **constants, "_id": number} for number, x in points]

    def ingest(self, results: list[dict]) -> None:
        """Receive results in any order; InputError, a ValueError, is raised for points of other origin."""
        if results:
            value = np.array([each[self._name] for each in results], dtype=float)
            sign = 1 if isinstance(self._constraint, LessThanConstraint) else -1
            margin = sign * (self._constraint.value - value)
            numbers, failed = [each.get("_id", -1) for each in results], np.isnan(margin)
            self.sampler.tell(margin <= 0, margin, runs=numbers, failed=failed)

    def estimate(self) -> Estimate:
        """Return the probability that the constraint is violated, from the results so far."""
        return self.sampler.estimate(self.stopping)
