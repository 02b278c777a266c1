"""Finds a number of the table of claims where the table says that it stands, as a reader would."""

import math
import re
from pathlib import Path

import numpy as np
import pandas as pd

PLACE = re.compile(r"(?P<letter>[a-d]): (?P<table>\w+)\[(?P<conditions>.+)\]\.(?P<column>\w+)")


def number_at(folder: Path, table: str, conditions: str, column: str) -> float:
    """Return the mean of a column over the rows of a published table that meet the conditions."""
    rows = pd.read_csv(folder / f"{table}.csv")
    for condition in conditions.split("; "):
        name, value = condition.split("=")
        if value in ("largest", "smallest"):
            chosen = rows[name] == (rows[name].max() if value == "largest" else rows[name].min())
        elif pd.api.types.is_numeric_dtype(rows[name]):
            chosen = rows[name] == float(value)
        else:
            chosen = rows[name] == value
        rows = rows[chosen]
        if rows.empty:
            raise ValueError(f"no row of {table} has {condition}")
    return rows[column].mean()


def found(folder: Path, claim: pd.Series) -> float:
    """Return the number of a claim, computed from the published tables of a folder by its formula."""
    places = [PLACE.fullmatch(text).groupdict() for text in claim["rows"].split(" | ")]
    assert ", ".join(dict.fromkeys(place["table"] for place in places)) == claim["table"]
    numbers = {place.pop("letter"): number_at(folder, **place) for place in places}
    return eval(claim["formula"], {"log10": math.log10}, numbers)


def contradicted(folder: Path) -> list[str]:
    """Return the keys of the published claims whose number is not where the table says that it stands.

    Published numbers have six digits. A ratio therefore has five, and a difference from one or a logarithm
    has as many decimals.
    """
    claims = pd.read_csv(folder / "claims.csv").dropna(subset="ours")
    differences = claims["formula"].str.startswith(("1 -", "log10"))
    tolerances = 5e-5 * np.maximum(claims["ours"].abs(), differences)
    numbers = [found(folder, claim) for _, claim in claims.iterrows()]
    return claims.loc[~((claims["ours"] - numbers).abs() <= tolerances), "key"].tolist()
