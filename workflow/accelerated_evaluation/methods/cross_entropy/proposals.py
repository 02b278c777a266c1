"""Results of Cross-Entropy searches, the distribution f* of each stratum, and their file."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import read_json, write_json
from accelerated_evaluation.laws import Factors
from accelerated_evaluation.laws.distributions import from_dict
from accelerated_evaluation.methods.cross_entropy.search import Search


@dataclass(frozen=True)
class Proposals:
    """The accelerated distribution f* of each stratum, with the number of simulations of its search."""

    factors: Mapping[str, Factors]  # f* in the coordinates of each stratum
    simulations: Mapping[str, int]  # number of simulations of each search
    # Strata whose search did not reach the event, with the reason.
    unfinished: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, searches: Mapping[str, Search]) -> Self:
        """Return f* and the number of simulations of each stratum, given the searches by stratum."""
        factors = {stratum: search.proposal for stratum, search in searches.items()}
        simulations = {stratum: search.simulations for stratum, search in searches.items()}
        reasons = {stratum: search.unfinished for stratum, search in searches.items() if search.unfinished}
        return cls(factors, simulations, reasons)

    def only(self, stratum: str) -> Self:
        """Return the proposals restricted to one stratum, given by its name."""
        reason = {stratum: self.unfinished[stratum]} if stratum in self.unfinished else {}
        return type(self)({stratum: self.factors[stratum]}, {stratum: self.simulations[stratum]}, reason)

    @property
    def total(self) -> int:
        """Total number of simulations of all searches."""
        return sum(self.simulations.values())


def write_proposals(path: str | os.PathLike, proposals: Proposals) -> None:
    """Write f* of each stratum to a JSON file, atomically."""
    content = {
        stratum: {
            "simulations": proposals.simulations[stratum],
            "first": f.first.to_dict(),
            "second": f.second.to_dict(),
        }
        | ({"unfinished": proposals.unfinished[stratum]} if stratum in proposals.unfinished else {})
        for stratum, f in proposals.factors.items()
    }
    write_json(path, content)


def read_proposals(path: str | os.PathLike) -> Proposals:
    """Return f* of each stratum from a file of `write_proposals`; InputError is raised if it is damaged."""
    try:
        content = read_json(path)
        factors = {
            stratum: Factors(from_dict(found["first"]), from_dict(found["second"]))
            for stratum, found in content.items()
        }
        simulations = {stratum: found["simulations"] for stratum, found in content.items()}
        reasons = {
            stratum: found["unfinished"] for stratum, found in content.items() if "unfinished" in found
        }
        return Proposals(factors, simulations, reasons)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            str(path),
            seen=f"{type(error).__name__}: {error}",
            expected="a file of accelerated distributions",
            change="Delete the file, and run the search again.",
        ) from error
