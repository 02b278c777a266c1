"""Injury probability curves of the United States' road safety administration."""

from accelerated_evaluation.answer.injuries.curves import FRONTAL, MILES_PER_HOUR, REAR, Logistic, Source
from accelerated_evaluation.answer.injuries.sources import SOURCES

COEFFICIENTS = {
    ("MAIS2+", FRONTAL): (-4.9429, 0.1425),
    ("MAIS3+", FRONTAL): (-6.9774, 0.1620),
    ("fatal", FRONTAL): (-9.0422, 0.1571),
    ("MAIS2+", REAR): (-6.1818, 0.1482),
    ("MAIS3+", REAR): (-8.0329, 0.1793),
    ("fatal", REAR): (-12.1982, 0.2255),
}


@SOURCES.add("wang_2022")
def wang_2022() -> Source:
    """Return the curves of Wang (2022) for frontal and rear-end crashes."""
    return Source(
        name="Wang 2022",
        reference="J.-S. Wang, MAIS(05/08) injury probability curves as functions of delta V, "
        "National Highway Traffic Safety Administration",
        doi="report DOT HS 813 219",
        table="Tables A-6 (frontal) and A-9 (rear-end)",
        population="occupants of light vehicles in crashes with a towed vehicle, United States, NASS-CDS "
        "2010-2015; belt use is not separated",
        checked="three independent public transcriptions of the tables agree in every digit; the report "
        "itself was not at hand, and neither were standard errors",
        curves={key: Logistic(*values, MILES_PER_HOUR) for key, values in COEFFICIENTS.items()},
    )
