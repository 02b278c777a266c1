"""Names in words of the vehicles, for figures, tables and the explorer."""

import pandas as pd

NAMES = {
    "under test": "car under test",
    "acc_aeb": "car with ACC and emergency braking",
    "acc_only": "car with ACC alone",
    "cc_human": "careful human (UN R157)",
    "reg157": "braking model of UN R157",
    "rss": "RSS driver",
    "fsm": "FSM driver",
    "human": "random human driver",
}


def in_words(vehicles: pd.Series) -> pd.Series:
    """Return the names of vehicles in words, shape (n,); a name that is not known here stays as it is."""
    return vehicles.replace(NAMES)
