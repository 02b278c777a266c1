"""Numbers in the paper: the crash probability, and numbers of simulations and parameters by method."""

PAPER_PROBABILITY = 7.4e-7  # section VI.C
PAPER_SIMULATIONS = {"piecewise": 7840, "single": 12320, "crude": 5.5e7}  # table I
PAPER_RATIOS = {"piecewise": 1, "single": 1.57, "crude": 7e3}  # table I
PAPER_SEARCHES = {"piecewise": 24000, "single": 30000}  # table II
PAPER_PARAMETERS = {"piecewise": 18, "single": 4}  # table II, of fitting and of Cross-Entropy
