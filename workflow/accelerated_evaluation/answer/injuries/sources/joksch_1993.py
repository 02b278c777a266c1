"""The rule of thumb for the risk of death."""

from accelerated_evaluation.answer.injuries.curves import FRONTAL, MILES_PER_HOUR, Power, Source
from accelerated_evaluation.answer.injuries.sources import SOURCES


@SOURCES.add("joksch_1993")
def joksch_1993() -> Source:
    """Return the risk of death by Joksch (1993), which is proportional to the fourth power of the delta-v."""
    return Source(
        name="Joksch 1993",
        reference="H. C. Joksch, Velocity change and fatality risk in a crash - a rule of thumb, Accident "
        "Analysis and Prevention 25(1), 103-104",
        doi="10.1016/0001-4575(93)90102-3",
        table="rule in the text",
        population="car drivers in crashes of any direction, United States, NASS 1980-1986; belt use is not "
        "separated",
        checked="two public sources: the exponent in the abstract, and 31.74 m/s (71 mph) in a catalogue of "
        "criticality metrics; the paper was not at hand, and its DOI was not resolved",
        curves={("fatal", FRONTAL): Power(71, 4, MILES_PER_HOUR)},
    )
