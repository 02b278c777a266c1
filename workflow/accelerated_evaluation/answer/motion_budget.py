"""The contribution of the unknown lead motion to the uncertainty of the answer."""

import numpy as np
import pandas as pd

MOTION = "what the other car does next"


def motion_budget(moving: pd.DataFrame, vehicle: str, together: float) -> pd.DataFrame:
    """Return the contribution of the unknown lead motion to the budget of the answer.

    Lead motion multiplies the crash probability by a factor. The law of motion was fitted to all cars. It is
    not known whether cars that have just changed lane change their speed as much as other cars. The changes
    of speed are therefore multiplied by a scale that is uniform from 0 to 1. The logarithm of the factor, as
    a function of the scale, is interpolated by a parabola through its values at 0, 1/2 and 1. Its variance is
    the contribution. ``together`` is the factor, exp(standard deviation of the log probability), of all other
    sources together. The ``variance_share`` is relative to their variance, and ``effect`` is the factor of
    the probability for the scale 1. There is no row if the vehicle is not in the table or never crashes.
    """
    own = moving[(moving["vehicle"] == vehicle) & (moving["gap"] == "closing")]
    own = own[(own["factor"] > 0) & (own["factor_half"] > 0)]
    half, whole = (np.log(own[name].astype(float)) for name in ("factor_half", "factor"))
    slope, bend = 4 * half - whole, 2 * whole - 4 * half
    # For a uniform variable s on [0, 1]: var(s) = 1/12, var(s^2) = 4/45, cov(s, s^2) = 1/12.
    variance = (
        slope**2 / 12 + slope * bend / 6 + 4 * bend**2 / 45 + (own["factor_error"] / own["factor"]) ** 2
    )
    return pd.DataFrame(
        {
            "source": MOTION,
            "factor": np.exp(np.sqrt(variance)),
            "variance_share": variance / np.log(together) ** 2,
            "effect": own["factor"],
        }
    )
