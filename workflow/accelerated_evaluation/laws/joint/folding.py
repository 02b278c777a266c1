"""Folding of a joint law: the distribution with one variable replaced by its absolute value."""

import numpy as np

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws.joint.truncated import Normals
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture
from accelerated_evaluation.laws.protocol import Box

BEYOND = 1e-3  # largest error of the total probability that is accepted if the box is not symmetric
LEAST_SHARE = 1e-9  # components with a smaller share are dropped


def folded(law: TruncatedNormalMixture, variable: int) -> TruncatedNormalMixture:
    """Return the law in which one variable is replaced by its absolute value.

    Each component becomes two: its part above zero, and the mirror image of its part below zero. Folding
    helps the sampler in normal scores if events occur at values near zero of either sign. These values are a
    thin layer in the middle of the distribution of the variable, but the lower tail of its absolute value.
    InputError is raised if the limits of the variable are not symmetric, so that the total probability of the
    folded law would differ from 1 by more than `BEYOND`.
    """
    box, mean, covariance = law.box, law.normals.mean, law.normals.covariance
    sign = np.ones(law.dimension)
    sign[variable] = -1
    reach = max(-box.lower[variable], box.upper[variable])
    upper = (*box.upper[:variable], reach, *box.upper[variable + 1 :])
    whole = Box(box.names, (*box.lower[:variable], 0.0, *box.lower[variable + 1 :]), upper)
    means = np.concatenate([mean, mean * sign])
    covariances = np.concatenate([covariance, covariance * np.outer(sign, sign)])
    masses = np.tile(law.normals.masses, 2)
    shares = np.tile(law.shares, 2) * Normals(means, covariances, whole).masses / masses
    beyond = abs(shares.sum() - 1)
    if beyond > BEYOND:
        raise InputError(
            f"the limits of {box.names[variable]}",
            seen=f"{box.lower[variable]:g} to {box.upper[variable]:g}, with a probability of {beyond:.2g} "
            "beyond the mirror image of the nearer limit",
            expected="symmetric limits",
            change="Fit the law within symmetric limits, or to absolute values.",
        )
    kept = shares > LEAST_SHARE
    shares = shares[kept] / shares[kept].sum()
    return TruncatedNormalMixture(shares, Normals(means[kept], covariances[kept], whole))
