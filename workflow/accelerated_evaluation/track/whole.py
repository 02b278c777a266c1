"""The answer of a campaign under the draws of a mean law, which includes the uncertainty of the records."""

from pathlib import Path

import numpy as np
from fewruns.several_laws import SeveralLaws

from accelerated_evaluation.answer.averaged import Course, answer_in_words, answer_row, budget_in_words
from accelerated_evaluation.answer.posterior import budget
from accelerated_evaluation.answer.reweighting import LEVEL, draws_of
from accelerated_evaluation.answer.study import event_name
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws import Law
from accelerated_evaluation.laws.files import read_law, require_shares
from accelerated_evaluation.laws.joint import JointLaw
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.records.encounter_table import read_encounters
from accelerated_evaluation.track.campaign import Campaign

ALONE = (
    "laws        the interval above is that of the sampling alone; with --under "
    "results/STUDY/estimate/law.json, the status also reports the uncertainty of the records"
)
JOINT = "laws        the interval above is that of the sampling alone, under one law of the scenario"
FEWEST = 10  # with fewer effective events under a draw, the standard error is not reliable
MOST_UNKNOWN = 0.05  # if a larger share of the draws has fewer effective events, a warning is given


def read_draws(path: Path, campaign: Campaign) -> MeanLaw:
    """Read a law with draws, to which the runs of a campaign can be reweighted.

    Parameters
    ----------
    path
        Law file that contains draws of its parameters.
    campaign
        The campaign. The law must have been fitted to its encounter table.

    Raises
    ------
    InputError
        If the file is a law without draws, if the law was fitted to other encounters, or if the scenario of
        the campaign is not the cut-in.
    """
    if campaign.encounters is None:
        seen, expected = f"the scenario {campaign.scenario.name}", "cut_in"
        raise InputError("--under", seen=seen, expected=expected, change="Leave the option out.")
    encounters = read_encounters(campaign.encounters.file)
    law = read_law(path, encounters)
    require_shares(path, law, encounters)
    if not isinstance(law, MeanLaw):
        change = "Name results/STUDY/estimate/law.json, which `accelerated-evaluation estimate` writes."
        raise InputError("--under", seen=f"the single law {path}", expected="a law with draws", change=change)
    return law


def whole_in_words(campaign: Campaign, law: Law | JointLaw, draws: MeanLaw | None = None) -> list[str]:
    """Return lines of text with the probability that a campaign estimates under all draws of a law.

    Parameters
    ----------
    campaign
        The campaign; the runs of its open batch are not used.
    law
        The law under which the runs were chosen.
    draws
        The law for whose draws the runs are reweighted; by default ``law``, if it has draws.
    """
    if isinstance(law, JointLaw):
        return [JOINT]
    if draws is None and not isinstance(law, MeanLaw):
        return [ALONE]
    sampler = campaign.sampler
    course = Course(law, sampler, draws_of(law)) if draws is None else read_under(campaign, law, draws)
    posterior = course.refined()
    if posterior is None:
        return ["laws        there is no estimate under the draws of the law yet"]
    row = {"event": event_name(campaign.event), "per_km": float("nan")} | answer_row(
        posterior, course.unseen_lapses()
    )
    gain = 1 - 1 / (1 + max(posterior.share_of_sampling, 0.0))
    return [
        *answer_in_words(row),
        *budget_in_words(budget(posterior.alone, posterior.deviation)),
        f"more runs would make the {LEVEL:.0%} interval at most {gain:.0%} narrower; the rest is "
        "the uncertainty of the records, which only more records reduce",
        *([] if draws is None else _reach(course.draws.effective_events(sampler.progress))),
    ]


def read_under(campaign: Campaign, law: Law, draws: MeanLaw) -> Course:
    """Return the runs of a campaign with density ratios f_k / f for each draw k of another law.

    A cut-in with a closing speed above the cap of the campaign's law was driven with the cap. Its outcome is
    also used for the larger closing speed.

    Parameters
    ----------
    campaign
        The campaign.
    law
        The law f under which the runs were chosen.
    draws
        The mean law with the draws f_k.

    Returns
    -------
    Course
        The runs of the complete batches with their outcomes and ratios, from which the probability under each
        draw is estimated.
    """

    def log_ratios(z: Array) -> Array:
        return draws.log_densities(law.from_normal_scores(z)) - log_density(law, z)

    return Course(draws, campaign.sampler, SeveralLaws(log_ratios))


def log_density(law: Law, z: Array) -> Array:
    """Return the joint log density of log R and closing speed [m/s] given v_L, shape (n,).

    R is the range [m] and v_L the lead speed. The closing speed is not capped.

    Parameters
    ----------
    law
        Any law of cut-ins.
    z
        Normal scores of cut-ins (coordinates in which the law is standard normal), shape (n, 3).
    """
    density = np.empty(len(z))
    for here, stratum, lead_speed, first, second in law.in_strata(z):
        cut_ins = stratum.cut_ins(lead_speed, first, second)
        place = lead_speed, cut_ins.inverse_range
        slopes = stratum.log_first_slope(*place) + np.log(cut_ins.inverse_range)
        slopes += stratum.log_second_slope(*place, cut_ins.closing_speed)
        density[here] = stratum.factors.logpdf(first, second) + slopes
    return density


def _reach(effective: Array) -> list[str]:
    """Return lines of text about the effective number of events under the draws.

    Parameters
    ----------
    effective
        Effective number of events under each draw, shape (K,).
    """
    few = np.mean(effective < FEWEST)
    low, middle = np.quantile(effective, (0.05, 0.5))
    lines = [
        f"effective   {middle:.0f} events under the median draw, {low:.0f} or more under 95 % of the draws; "
        "the runs were chosen under one law"
    ]
    if few > MOST_UNKNOWN:
        lines.append(
            f"warning     fewer than {FEWEST} effective events under {few:.0%} of the draws: the runs hardly "
            "reach where these laws put the event, so that the interval above may be wrong. More runs under "
            "the same law help little; begin another campaign under the law with draws"
        )
    return lines
