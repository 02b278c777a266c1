"""Injury curves of the 1990s, with the direction of the force."""

from accelerated_evaluation.answer.injuries.curves import (
    FRONTAL,
    LEVELS,
    MILES_PER_HOUR,
    REAR,
    Logistic,
    Source,
)
from accelerated_evaluation.answer.injuries.sources import SOURCES

# By level: intercept, slope, and what is added to the intercept if the force comes from behind.
COEFFICIENTS = {"MAIS2+": (-4.029, 0.155, -1.177), "MAIS3+": (-5.820, 0.202, -2.170)}
COEFFICIENTS["fatal"] = (-9.032, 0.198, -1.921)


@SOURCES.add("malliaris_1997")
def malliaris_1997() -> Source:
    """Return the curves of Malliaris and others (1997) for frontal impacts and impacts from behind."""
    curves = {}
    for level in LEVELS:
        intercept, slope, from_behind = COEFFICIENTS[level]
        curves[level, FRONTAL] = Logistic(intercept, slope, MILES_PER_HOUR)
        curves[level, REAR] = Logistic(round(intercept + from_behind, 3), slope, MILES_PER_HOUR)
    return Source(
        name="Malliaris 1997",
        reference="A. C. Malliaris, K. H. Digges and J. H. DeBlois, Relationships between crash casualties "
        "and crash attributes, SAE paper 970393",
        doi="10.4271/970393",
        table="model with delta-v and direction of the force; the number of the table is not known",
        population="occupants of cars in crashes, United States, before 1997; the sample is not known in "
        "detail, and belt use is not separated",
        checked="one public transcription; at 30 and 60 mph the frontal fatal curve gives 4 and 95 %, "
        "compared with 3 and 92 % that are reported of belted drivers in Richards and Cuerden (2009); above "
        "38 mph, MAIS3+ is more probable than MAIS2+, which cannot be; the paper was not at hand",
        curves=curves,
    )
