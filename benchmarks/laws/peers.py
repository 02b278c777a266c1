"""Laws of public libraries, on scores of all three variables: a vine copula and a mixture of Gaussians.

Lead speed and range are turned to scores by their ranks, the closing speed by ranks below a quantile and an
exponential above it, so that it can be larger than any that was recorded.
"""

from dataclasses import dataclass

import numpy as np
import pyvinecopulib as pv
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.laws.smooth.conditional import Places
from accelerated_evaluation.laws.smooth.family import DistinctRecords
from scipy.special import log_ndtr, logsumexp, ndtri
from scipy.stats import norm
from sklearn.mixture import GaussianMixture

LEVEL = 0.98  # of the threshold of the margin of the closing speed
NODES = 2000  # quantiles that hold a margin's body
COMPONENTS = 8
FAMILIES = [  # of the pairs, in all their rotations
    getattr(pv.BicopFamily, name)
    for name in ("indep", "gaussian", "student", "clayton", "gumbel", "frank", "joe")
]
EDGE = 1e-9  # pseudo-observations stay this far inside the unit interval


@dataclass(frozen=True)
class Margin:
    """A distribution function, linear between quantiles; exponential above one where it has a tail."""

    nodes: Array
    levels: Array
    mean_excess: float | None

    @classmethod
    def fit(cls, x: Array, *, tail: bool) -> "Margin":
        """Fit to a sample."""
        levels = np.linspace(0, LEVEL if tail else 1, NODES)
        nodes = np.quantile(x, levels)
        nodes[0] = 0 if tail else nodes[0]
        nodes, first = np.unique(nodes, return_index=True)
        mean_excess = float((x[x > nodes[-1]] - nodes[-1]).mean()) if tail else None
        return cls(nodes, levels[first], mean_excess)

    def cdf(self, x: Array) -> Array:
        """P(X <= x)."""
        below = np.interp(x, self.nodes, self.levels)
        if self.mean_excess is None:
            return np.clip(below, EDGE, 1 - EDGE)
        above = 1 - (1 - LEVEL) * np.exp(-np.maximum(x - self.nodes[-1], 0) / self.mean_excess)
        return np.clip(np.where(x > self.nodes[-1], above, below), EDGE, 1 - EDGE)

    def log_density(self, x: Array) -> Array:
        """Log density."""
        slope = np.diff(self.levels) / np.diff(self.nodes)
        place = np.clip(np.searchsorted(self.nodes, x, side="right") - 1, 0, slope.size - 1)
        above = np.log((1 - LEVEL) / self.mean_excess) - (x - self.nodes[-1]) / self.mean_excess
        return np.where(x > self.nodes[-1], above, np.log(slope[place]))


class Joint:
    """Margins of lead speed, range and closing speed, and what ties them."""

    def __init__(self, events: DistinctRecords) -> None:
        self.margins = [
            Margin.fit(x, tail=tail)
            for x, tail in ((events.lead_speed, False), (events.range_, False), (events.closing_speed, True))
        ]

    def scores(self, places: Places, closing_speed: Array) -> Array:
        """Return the ranks of all three, shape (n, 3)."""
        columns = places.lead_speed, places.range_, closing_speed
        return np.column_stack([margin.cdf(x) for margin, x in zip(self.margins, columns, strict=True)])

    def given(self, places: Places) -> "GivenJoint":
        """Return the law at places."""
        return GivenJoint(self, places)


class Vine(Joint):
    """A vine of parametric pair copulas (pyvinecopulib), chosen by BIC; the closing speed comes last."""

    name = "vine copula"

    def __init__(self, events: DistinctRecords) -> None:
        super().__init__(events)
        places = Places(events.lead_speed, events.range_, *2 * [np.empty((0, 0))])
        # In a D-vine of order (closing speed, range, lead speed) the first is given the other two by
        # Rosenblatt.
        controls = pv.FitControlsVinecop(family_set=FAMILIES, selection_criterion="bic")
        ranks = self.scores(places, events.closing_speed)
        self.vine = pv.Vinecop.from_data(ranks, structure=pv.DVineStructure([3, 2, 1]), controls=controls)
        self.pair = pv.Bicop.from_data(
            ranks[:, :2], controls=pv.FitControlsBicop(family_set=FAMILIES, selection_criterion="bic")
        )

    def log_conditional_density(self, ranks: Array) -> Array:
        """Log density of the rank of the closing speed given the other two."""
        return np.log(np.maximum(self.vine.pdf(ranks), 1e-300)) - np.log(
            np.maximum(self.pair.pdf(ranks[:, :2]), 1e-300)
        )

    def log_survival(self, ranks: Array) -> Array:
        """Log probability that the closing speed exceeds its rank given the other two."""
        return np.log(np.maximum(1 - self.vine.rosenblatt(ranks)[:, 2], 1e-15))


class Mixture(Joint):
    """A mixture of Gaussians on normal scores (scikit-learn)."""

    name = "Gaussian mixture of scores"

    def __init__(self, events: DistinctRecords) -> None:
        super().__init__(events)
        places = Places(events.lead_speed, events.range_, *2 * [np.empty((0, 0))])
        z = ndtri(self.scores(places, events.closing_speed))
        self.mixture = GaussianMixture(COMPONENTS, random_state=0, max_iter=60, tol=1e-3).fit(z)

    def _parts(self, ranks: Array) -> tuple[Array, Array, Array]:
        """Return by component the log weight given two scores, and location and scale of the third."""
        z, mixture = ndtri(ranks), self.mixture
        weights, locations, scales = [], [], []
        for weight, mean, covariance in zip(
            mixture.weights_, mixture.means_, mixture.covariances_, strict=True
        ):
            two, cross = covariance[:2, :2], covariance[2, :2]
            away, slope = z[:, :2] - mean[:2], np.linalg.solve(two, cross)
            distance = np.einsum("ni,ij,nj->n", away, np.linalg.inv(two), away)
            weights.append(np.log(weight) - (distance + np.linalg.slogdet(two)[1]) / 2)
            locations.append(mean[2] + away @ slope)
            scales.append(np.full(len(z), np.sqrt(covariance[2, 2] - cross @ slope)))
        logs = np.array(weights)
        return logs - logsumexp(logs, axis=0), np.array(locations), np.array(scales)

    def log_conditional_density(self, ranks: Array) -> Array:
        """Log density of the rank of the closing speed given the other two."""
        logs, locations, scales = self._parts(ranks)
        z = ndtri(ranks[:, 2])
        return logsumexp(logs + norm.logpdf(z, locations, scales), axis=0) - norm.logpdf(z)

    def log_survival(self, ranks: Array) -> Array:
        """Log probability that the closing speed exceeds its rank given the other two."""
        logs, locations, scales = self._parts(ranks)
        return logsumexp(logs + log_ndtr((locations - ndtri(ranks[:, 2])) / scales), axis=0)


@dataclass(frozen=True)
class GivenJoint:
    """The law of the closing speed at places."""

    joint: Joint
    places: Places

    def log_density(self, closing_speed: Array) -> Array:
        """Return the log density, one a place."""
        ranks = self.joint.scores(self.places, closing_speed)
        return self.joint.log_conditional_density(ranks) + self.joint.margins[2].log_density(closing_speed)

    def cumulative(self, closing_speed: Array) -> Array:
        """Return -log P(C > c), one a place."""
        return -self.joint.log_survival(self.joint.scores(self.places, closing_speed))


PEERS = (Vine, Mixture)
