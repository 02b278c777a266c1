"""A toy: a figure of the answer, which the study draws without a chapter."""

import matplotlib.pyplot as plt
import pandas as pd
from accelerated_evaluation.publishing.published import figure
from matplotlib.figure import Figure


@figure
def toy_figure(answer: pd.DataFrame, source: str) -> tuple[Figure, pd.DataFrame]:
    """Draw the probability of each event of the answer."""
    data = answer[["event", "probability"]].assign(data=source)
    drawn, axes = plt.subplots()
    axes.plot(range(len(data)), data["probability"], "o", color="black")
    axes.set(xlabel="event", ylabel="probability per cut-in", yscale="log")
    return drawn, data
