"""What the other car does next: a line of the budget of the answer."""

import numpy as np
import pandas as pd

MOTION = "what the other car does next"


def motion_budget(moving: pd.DataFrame, vehicle: str, together: float) -> pd.DataFrame:
    """Return what not knowing the lead motion adds to the budget of the answer of a vehicle.

    The law of motion is that of all cars. Whether cars that have just changed lane move as much, less or not
    at all is not known: the scale of their changes of speed is taken to be uniform from 0 to 1. The logarithm
    of the factor is interpolated by a parabola through its values for the scales 0, 1/2 and 1.

    Parameters
    ----------
    moving
        The table of `motion_tables.motion_table`.
    vehicle
        Name of the vehicle.
    together
        Factor of the other sources together, as in `posterior.budget`.

    Returns
    -------
    pandas.DataFrame
        One row as in `posterior.budget`, whose ``variance_share`` is relative to the variance of the other
        sources together, and ``effect``, the factor by which the motion of all cars multiplies the
        probability. No row if the vehicle is not in the table or never crashes.
    """
    own = moving[(moving["vehicle"] == vehicle) & (moving["gap"] == "closing")]
    own = own[(own["factor"] > 0) & (own["factor_half"] > 0)]
    half, whole = (np.log(own[name].astype(float)) for name in ("factor_half", "factor"))
    slope, bend = 4 * half - whole, 2 * whole - 4 * half
    # Variances and covariance of a uniform variable s and of its square: 1/12, 4/45 and 1/12.
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
