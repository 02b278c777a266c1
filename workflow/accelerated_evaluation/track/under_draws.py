"""The probability that a campaign estimates, under all draws of a law."""

from pathlib import Path

import numpy as np
from fewruns import Sampler, SeveralLaws

from accelerated_evaluation.answer.ways.by_few_runs import laws_of
from accelerated_evaluation.answer.ways.posterior import LEVEL, SampledPosterior, answer_row, budget
from accelerated_evaluation.answer.ways.words import answer_in_words, budget_in_words
from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.laws import Law
from accelerated_evaluation.laws.draws import Draws, as_draws
from accelerated_evaluation.track.campaign import Campaign
from accelerated_evaluation.track.law_files import law_in, source_of

ALONE = (
    "laws        the interval above is that of the sampling alone; with --under "
    "results/STUDY/estimate/law.json, the status also reports the uncertainty of the records"
)
FEWEST = 10  # with fewer effective events under a draw, the standard error is not reliable
MOST_UNKNOWN = 0.05  # if a larger share of the draws has fewer effective events, a warning is given


def read_draws(path: Path, campaign: Campaign) -> Draws:
    """Read a law with draws, to which the runs of a campaign can be reweighted; else InputError.

    A law of cut-ins must have been fitted to the encounter table of the campaign.
    """
    draws = as_draws(law_in(campaign.scenario, source_of(path), campaign.encounters))
    if draws.size == 1:
        change = "Name results/STUDY/estimate/law.json, which `accelerated-evaluation estimate` writes."
        raise InputError("--under", seen=f"the single law {path}", expected="a law with draws", change=change)
    return draws


def whole_in_words(campaign: Campaign, law: Law, draws: Draws | None = None) -> list[str]:
    """Return lines of text with the probability that a campaign estimates under all draws of a law.

    The runs of the open batch are not used. The runs were chosen under ``law``, whose draws, if it has any,
    are the default.
    """
    under = as_draws(law) if draws is None else draws
    if under.size == 1:
        return [ALONE]
    laws = laws_of(under, law.from_normal_scores) if draws is None else laws_under(law, under)
    found = laws.refined(campaign.sampler)
    if found is None:
        return ["laws        there is no estimate under the draws of the law yet"]
    posterior = SampledPosterior.of(found, under.member, campaign.sampler.progress.unseen_lapses)
    row = {"event": campaign.scenario.event_in_words(campaign.event), "per_km": float("nan")}
    gain = 1 - 1 / (1 + max(posterior.share_of_sampling, 0.0))
    return [
        *answer_in_words(row | answer_row(posterior), posterior.sources, campaign.scenario.noun),
        *budget_in_words(budget(posterior.alone, posterior.deviation)),
        f"more runs would make the {LEVEL:.0%} interval at most {gain:.0%} narrower; the rest is "
        "the uncertainty of the records, which only more records reduce",
        *([] if draws is None else _reach(laws, campaign.sampler)),
    ]


def laws_under(law: Law, draws: Draws) -> SeveralLaws:
    """Return draws with density ratios f_k / f to another law f, under which runs were chosen.

    A cut-in with a closing speed above the cap of that law was driven with the cap. Its outcome is used for
    all closing speeds from the cap on, so the draws get the same cap.
    """
    if law.strata:
        draws = draws.with_cap_at(law.closing_speed_max)

    def log_ratios(x: Array) -> Array:
        return draws.log_densities(x) - law.log_density(x)

    return SeveralLaws(log_ratios, law.from_normal_scores)


def _reach(laws: SeveralLaws, sampler: Sampler) -> list[str]:
    """Return lines of text about the effective number of events under each of K draws."""
    if sampler.is_counted:
        return []
    effective = laws.effective_events(sampler.progress)
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
