"""A mean law of 60 draws, and the probability under each draw that a cut-in needs hard braking."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer.candidates.law_study import LawStudy
from accelerated_evaluation.answer.candidates.smooth_family import SmoothFamily
from accelerated_evaluation.laws.smooth.draws import SmoothDraws
from accelerated_evaluation.laws.smooth.family import DistinctRecords, Member
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.laws.smooth.support import Support
from accelerated_evaluation.records.segments import complete
from scipy.special import ndtri

SUPPORT = Support((5.0, 25.0), 60.0, 20.0, (15.0,))
MEMBERS = (Member(), *(Member(0.9, shape) for shape in ("exponential", "generalised", "two kinds")))
PLACES, GOLDEN, EDGE = 20_000, 0.6180339887498949, 1e-15  # of the lattice
DRAWS = 60  # ten more than share a body


@pytest.fixture(scope="module", name="encounters")
def encounters_():
    generator = np.random.default_rng(5)
    lead_speed, range_ = generator.uniform(5, 25, 3000), 60 * generator.beta(2, 1.2, 3000)
    closing_speed = generator.exponential(0.5 + 0.03 * range_).clip(0, 19.9)
    segment = np.where(lead_speed < 15, "5-15", "15-25")
    columns = {"lead_speed": lead_speed, "range": range_, "closing_speed": closing_speed}
    return complete(pd.DataFrame(columns)).assign(segment=segment)


@pytest.fixture(scope="module", name="law")
def law_(encounters):
    family = SmoothFamily.of(DistinctRecords.of(encounters, SUPPORT), MEMBERS, 3)
    family = replace(family, encounters=encounters, closing_speed_max=40.0)
    weights = np.full((DRAWS, len(MEMBERS)), 1 / len(MEMBERS))
    return LawStudy(family, weights).draws(np.random.default_rng(2))


def one_draw(law, k, cap=np.inf):
    """Return draw k of a mean law as a law of its own."""
    draws = law.draws
    alone = SmoothDraws.of_laws(draws.ranges[draws.shared[k]], [draws.laws[k]], SUPPORT)
    return MeanLaw(f"draw {k}", law.counts, alone, law.lead_speeds, cap)


def braking_probabilities(law, deceleration):
    """P(C^2 / (2 R) > deceleration [m/s^2]) under every draw, over a lattice of lead speeds and ranges.

    The lattice is denser at short ranges, which have most of this probability: with u = 1 - v^4 and v uniform
    the weight of a place is 4 v^3. Other shifts of the lattice change the probabilities by less than 0.1 %.
    """
    place = np.arange(PLACES)
    v = (place * GOLDEN + 0.3) % 1
    scores = ndtri((place + 0.5) / PLACES), -ndtri(np.maximum(v**4, EDGE)), np.zeros(PLACES)
    found = []
    for k in range(law.draws.size):
        one = one_draw(law, k)
        lead_speed, range_, _ = one.from_normal_scores(np.column_stack(scores)).T
        second = one.strata["5-15"].second(lead_speed, 1 / range_, np.sqrt(2 * deceleration * range_))
        found.append((4 * v**3 * np.exp(-second)).mean())
    return np.array(found)
