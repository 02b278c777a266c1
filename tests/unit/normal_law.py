"""Laws of one normal distribution within limits, for left turns and in general."""

import numpy as np
from accelerated_evaluation.laws import Box
from accelerated_evaluation.laws.joint.truncated import Normals
from accelerated_evaluation.laws.joint.truncated_normals import TruncatedNormalMixture
from accelerated_evaluation.scenarios.left_turn import LEFT_TURN


def normal_law(mean, covariance, box):
    normals = Normals(np.array([mean], float), np.array([covariance], float), box)
    return TruncatedNormalMixture(np.ones(1), normals)


def left_turn_law(mean=(14, 7, 60), deviation=(5, 3, 25), upper=LEFT_TURN.limits[:, 1]):
    """Return a law of independent variables: both speeds [m/s], and the distance [m]."""
    box = Box(LEFT_TURN.names, (0.0, 0.0, 0.0), tuple(map(float, upper)))
    return normal_law(mean, np.diag(np.square(deviation)), box)
