"""The whole answer of a campaign under a mean law, with the uncertainty of the records."""

from accelerated_evaluation.answer.averaged import Course, answer_in_words, answer_row, budget_in_words
from accelerated_evaluation.answer.posterior import budget
from accelerated_evaluation.answer.reweighting import LEVEL
from accelerated_evaluation.laws import Law
from accelerated_evaluation.laws.joint import JointLaw
from accelerated_evaluation.laws.smooth.mean import MeanLaw
from accelerated_evaluation.track.campaign import Campaign

ALONE = (
    "laws        the interval above is that of the sampling alone; under results/STUDY/estimate/law.json, "
    "a campaign also reports the uncertainty of the records"
)


JOINT = "laws        the interval above is that of the sampling alone, under one law of the scenario"


def whole_in_words(campaign: Campaign, law: Law | JointLaw) -> list[str]:
    """Return the answer of a campaign under all draws of its law, in lines of text.

    Parameters
    ----------
    campaign
        The campaign; its open batch does not count.
    law
        Its law.
    """
    if isinstance(law, JointLaw):
        return [JOINT]
    if not isinstance(law, MeanLaw):
        return [ALONE]
    posterior = Course.of(law, campaign.sampler).refined()
    if posterior is None:
        return ["laws        nothing is known yet under the draws of the law"]
    row = {"event": campaign.event.in_words, "per_km": float("nan")} | answer_row(posterior)
    gain = 1 - 1 / (1 + max(posterior.share_of_sampling, 0.0))
    return [
        *answer_in_words(row),
        *budget_in_words(budget(posterior.alone, posterior.deviation)),
        f"more runs would make the {LEVEL:.0%} interval at most {gain:.0%} narrower; the rest is "
        "the uncertainty of the records, which only more records reduce",
    ]
