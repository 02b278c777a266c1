"""What searches found, f* of each stratum, and the file that keeps it."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from accelerated_evaluation.distributions import from_dict
from accelerated_evaluation.errors import InputError
from accelerated_evaluation.files import read_json, write_json
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.methods.cross_entropy.search import Search


@dataclass(frozen=True)
class Proposals:
    """f* of each stratum, and the simulations that the search for it took.

    Attributes
    ----------
    factors
        f* in the coordinates of each stratum.
    simulations
        Simulations of each search.
    """

    factors: Mapping[str, Factors]
    simulations: Mapping[str, int]

    @classmethod
    def of(cls, searches: Mapping[str, Search]) -> Self:
        """Take f* from finished searches, by stratum."""
        factors = {stratum: search.proposal for stratum, search in searches.items()}
        return cls(factors, {stratum: search.simulations for stratum, search in searches.items()})

    def only(self, stratum: str) -> Self:
        """Return what was found in one stratum."""
        return type(self)({stratum: self.factors[stratum]}, {stratum: self.simulations[stratum]})

    @property
    def total(self) -> int:
        """Simulations of all searches together."""
        return sum(self.simulations.values())


def write_proposals(path: str | os.PathLike, proposals: Proposals) -> None:
    """Write f* of each stratum as JSON, atomically."""
    content = {
        stratum: {
            "simulations": proposals.simulations[stratum],
            "first": f.first.to_dict(),
            "second": f.second.to_dict(),
        }
        for stratum, f in proposals.factors.items()
    }
    write_json(path, content)


def read_proposals(path: str | os.PathLike) -> Proposals:
    """Read what `write_proposals` wrote.

    Raises
    ------
    InputError
        If the file is damaged.
    """
    try:
        content = read_json(path)
        factors = {
            stratum: Factors(from_dict(found["first"]), from_dict(found["second"]))
            for stratum, found in content.items()
        }
        return Proposals(factors, {stratum: found["simulations"] for stratum, found in content.items()})
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            str(path),
            seen=f"{type(error).__name__}: {error}",
            expected="a file of accelerated distributions",
            change="Delete the file, and search anew.",
        ) from error
