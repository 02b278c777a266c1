"""A toy: a Lomax tail of shape 0.2, as a candidate for the closing speeds above the thresholds."""

import numpy as np
from accelerated_evaluation.laws.smooth.shapes import SHAPES, Generalised

FIXED = np.array([0.2])


class ToyShape(Generalised):
    """A generalised Pareto excess with a fixed shape, which is therefore no parameter."""

    name = "toy shape"
    prior_mean: tuple[float, ...] = ()
    prior_deviation: tuple[float, ...] = ()

    def cumulative(self, z, parameters):
        """Return the cumulative hazard at excesses z."""
        return super().cumulative(z, FIXED)

    def inverse(self, level, parameters):
        """Return the excess at which the cumulative hazard equals a level."""
        return super().cumulative(level, -FIXED)

    def log_density(self, z, parameters):
        """Return the log density at excesses z."""
        z = np.asarray(z, dtype=float)
        return -np.log1p(FIXED * z) - self.cumulative(z, parameters)

    def derivatives(self, z, parameters):
        """Return the derivatives of the log density by z and by no parameter."""
        by_z, _ = super().derivatives(z, FIXED)
        return by_z, np.empty((z.size, 0))


SHAPES.add(ToyShape.name)(ToyShape())
