"""The injury curve of studies of automatic emergency braking."""

from accelerated_evaluation.answer.injuries.curves import FRONTAL, KILOMETRES_PER_HOUR, Logistic, Source
from accelerated_evaluation.answer.injuries.sources import SOURCES

INTERCEPT, SLOPE, BELTED = -6.068, 0.100, -0.6234


@SOURCES.add("kusano_2012")
def kusano_2012() -> Source:
    """Return the curve of Kusano and Gabler (2012) for belted occupants of the striking car."""
    return Source(
        name="Kusano 2012",
        reference="K. D. Kusano and H. C. Gabler, Safety benefits of forward collision warning, brake "
        "assist, and autonomous braking systems in rear-end collisions, IEEE Transactions on Intelligent "
        "Transportation Systems 13(4), 1546-1555",
        doi="10.1109/TITS.2012.2191542",
        table="Table II, with the term of belted occupants",
        population="belted front occupants of the striking car in rear-end crashes, United States, NASS-CDS",
        checked="one public transcription, with the coding of belts (+1 belted, -1 unbelted); the paper was "
        "not at hand, and its DOI was not resolved",
        curves={("MAIS2+", FRONTAL): Logistic(INTERCEPT + BELTED, SLOPE, KILOMETRES_PER_HOUR)},
    )
