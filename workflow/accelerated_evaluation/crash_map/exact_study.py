"""Tables of exact values: probabilities by model and resolution, severity, and the variation of every f*."""

from collections.abc import Mapping

import pandas as pd

from accelerated_evaluation.crash_map.exact import exact_table
from accelerated_evaluation.crash_map.exact_variance import variation_table
from accelerated_evaluation.crash_map.maps import CrashMap
from accelerated_evaluation.crash_map.severity import impact_speed_table, severity_table
from accelerated_evaluation.laws import Factors, Law


def exact_tables(
    crash_maps: Mapping[str, CrashMap],
    laws: Mapping[str, Law],
    variant: str,
    proposals: Mapping[tuple[str, int], Mapping[str, Factors]],
    encounters: int,
    distance: float | None,
) -> dict[str, pd.DataFrame]:
    """Compute all tables of exact values from the crash maps and the laws.

    Parameters
    ----------
    crash_maps
        The maps by resolution; the map ``full`` contains all events.
    laws, variant
        The laws by name, and the name of the law that is simulated.
    proposals
        f* of each stratum, by method and seed of the search.
    encounters
        Number of recorded encounters.
    distance
        Distance driven while the lane changes were recorded [km]; None if it is unknown.

    Returns
    -------
    dict
        ``exact``, the probabilities under the law that is simulated; ``convergence``, those under all laws
        and for all resolutions; ``severity``, ``impact_speed`` and ``variation``.
    """
    full, studied = crash_maps["full"], laws[variant]
    convergence = exact_table(crash_maps, laws)
    chosen = (convergence["model"] == variant) & (convergence["resolution"] == "full")
    severity = severity_table(full, studied, encounters, distance=distance)
    return {
        "exact": convergence.loc[chosen, ["segment", "probability", "standard_error"]],
        "convergence": convergence,
        "severity": severity,
        "impact_speed": impact_speed_table(severity),
        "variation": variation_table(full, studied, proposals),
    }
