"""Published curves of the risk of injury, each with the information that a reader needs to check it.

Curves for frontal impacts are used for the driver of the car under test, and curves for impacts from behind
for the driver of the car that cuts in.
"""

from accelerated_evaluation.answer.consequences.injuries.curves import (
    FRONTAL,
    KILOMETRES_PER_HOUR,
    MILES_PER_HOUR,
    REAR,
    Logistic,
    Power,
    Publication,
    RiskCurve,
)

# Intercept, slope of the closing speed, and slope of the age at 39 years, the median in the sample. Cars of
# equal mass have a delta-v of half their closing speed, so the first slope is doubled.
LUBBE = Logistic(-7.654 + 0.021 * 39, 2 * 0.041, KILOMETRES_PER_HOUR)

# By level: intercept, slope, and what is added to the intercept if the force comes from behind.
MALLIARIS = {
    "MAIS2+": (-4.029, 0.155, -1.177),
    "MAIS3+": (-5.820, 0.202, -2.170),
    "fatal": (-9.032, 0.198, -1.921),
}

WANG = {
    ("MAIS2+", FRONTAL): (-4.9429, 0.1425),
    ("MAIS3+", FRONTAL): (-6.9774, 0.1620),
    ("fatal", FRONTAL): (-9.0422, 0.1571),
    ("MAIS2+", REAR): (-6.1818, 0.1482),
    ("MAIS3+", REAR): (-8.0329, 0.1793),
    ("fatal", REAR): (-12.1982, 0.2255),
}

SOURCES = {
    "joksch_1993": Publication(
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
    ),
    "kusano_2012": Publication(
        name="Kusano 2012",
        reference="K. D. Kusano and H. C. Gabler, Safety benefits of forward collision warning, brake "
        "assist, and autonomous braking systems in rear-end collisions, IEEE Transactions on Intelligent "
        "Transportation Systems 13(4), 1546-1555",
        doi="10.1109/TITS.2012.2191542",
        table="Table II, with the term of belted occupants",
        population="belted front occupants of the striking car in rear-end crashes, United States, NASS-CDS",
        checked="one public transcription, with the coding of belts (+1 belted, -1 unbelted); the paper was "
        "not at hand, and its DOI was not resolved",
        curves={("MAIS2+", FRONTAL): Logistic(-6.068 - 0.6234, 0.100, KILOMETRES_PER_HOUR)},
    ),
    "lubbe_2022": Publication(
        name="Lubbe 2022",
        reference="N. Lubbe, Y. Wu and H. Jeppsson, Safe speeds: fatality and injury risks of pedestrians, "
        "cyclists, motorcyclists, and car drivers impacting the front of another passenger car as a function "
        "of closing speed and age, Traffic Safety Research 2, 000006",
        doi="10.55329/vfma7555",
        table="Table 5, row MAIS3+F, at the median age of 39 years, delta-v = closing speed / 2",
        population="drivers of cars whose front hit the front of another car, Germany, GIDAS",
        checked="one public transcription; 10 % at the closing speed of 112 km/h that the abstract prints, "
        "as far as its rounded coefficients allow; other rows of the table were not at hand",
        curves={("MAIS3+", FRONTAL): LUBBE},
    ),
    "malliaris_1997": Publication(
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
        curves={
            (level, impact): Logistic(round(intercept + added, 3), slope, MILES_PER_HOUR)
            for level, (intercept, slope, from_behind) in MALLIARIS.items()
            for impact, added in ((FRONTAL, 0.0), (REAR, from_behind))
        },
    ),
    "wang_2022": Publication(
        name="Wang 2022",
        reference="J.-S. Wang, MAIS(05/08) injury probability curves as functions of delta V, "
        "National Highway Traffic Safety Administration",
        doi="report DOT HS 813 219",
        table="Tables A-6 (frontal) and A-9 (rear-end)",
        population="occupants of light vehicles in crashes with a towed vehicle, United States, NASS-CDS "
        "2010-2015; belt use is not separated",
        checked="three independent public transcriptions of the tables agree in every digit; the report "
        "itself was not at hand, and neither were standard errors",
        curves={key: Logistic(*values, MILES_PER_HOUR) for key, values in WANG.items()},
    ),
}


def published_curves(level: str, impact: str) -> dict[str, RiskCurve]:
    """Return the published curves for a level of injury and a struck end of a car, by name of the source."""
    return {
        source.name: source.curves[level, impact]
        for source in SOURCES.values()
        if (level, impact) in source.curves
    }
