"""The explorer: one page without a server, on which a reader changes the vehicle and sees the answer."""

from collections.abc import Callable

from accelerated_evaluation.answer.ways.explored import Sections
from accelerated_evaluation.answer.ways.explored_cut_ins import CutInSections
from accelerated_evaluation.answer.ways.explored_slices import SlicedSections
from accelerated_evaluation.scenarios import OfScenarios

# The draws of laws, for the scenarios whose vehicles the page can simulate.
EXPLORED: OfScenarios[Callable[..., Sections]] = OfScenarios("explorer", __name__, [])
EXPLORED.add("cut_in")(CutInSections.of)
EXPLORED.add("left_turn")(SlicedSections.of)
