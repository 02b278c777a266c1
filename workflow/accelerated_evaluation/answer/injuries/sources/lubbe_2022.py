"""An injury curve from German in-depth investigations, as a function of the closing speed."""

from accelerated_evaluation.answer.injuries.curves import FRONTAL, KILOMETRES_PER_HOUR, Logistic, Source
from accelerated_evaluation.answer.injuries.sources import SOURCES

INTERCEPT, PER_CLOSING_SPEED, PER_YEAR = -7.654, 0.041, 0.021
AGE = 39  # [years], the median of the car drivers in the sample


@SOURCES.add("lubbe_2022")
def lubbe_2022() -> Source:
    """Return the curve of Lubbe and others (2022) for car drivers.

    The delta-v of cars of equal mass is half of their closing speed, so the slope is doubled.
    """
    curve = Logistic(INTERCEPT + PER_YEAR * AGE, 2 * PER_CLOSING_SPEED, KILOMETRES_PER_HOUR)
    return Source(
        name="Lubbe 2022",
        reference="N. Lubbe, Y. Wu and H. Jeppsson, Safe speeds: fatality and injury risks of pedestrians, "
        "cyclists, motorcyclists, and car drivers impacting the front of another passenger car as a function "
        "of closing speed and age, Traffic Safety Research 2, 000006",
        doi="10.55329/vfma7555",
        table="Table 5, row MAIS3+F, at the median age of 39 years, delta-v = closing speed / 2",
        population="drivers of cars whose front hit the front of another car, Germany, GIDAS",
        checked="one public transcription; 10 % at the closing speed of 112 km/h that the abstract prints, "
        "as far as its rounded coefficients allow; other rows of the table were not at hand",
        curves={("MAIS3+", FRONTAL): curve},
    )
