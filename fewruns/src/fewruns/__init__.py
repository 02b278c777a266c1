"""The probability of a rare event from a few hundred runs of an expensive system."""

from importlib import import_module
from typing import Any

__version__ = "0.5.0"

# The module of each public name. It is imported when the name is first used, because NumPy and
# SciPy take half a second.
_HOME = {
    "Certificate": "certificate",
    "Cover": "cover",
    "Estimate": "estimates",
    "InputError": "errors",
    "LawEstimates": "several_laws",
    "Predecessor": "problems",
    "Sampler": "sampler",
    "ScoreProblem": "problems",
    "SeveralLaws": "several_laws",
    "Stopping": "estimates",
    "SystemProblem": "problems",
    "estimate": "running",
    "read_state": "state",
    "run_batches": "running",
    "write_state": "state",
}
__all__ = sorted(_HOME)


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name not in _HOME:
        raise AttributeError(f"module 'fewruns' has no attribute {name!r}")
    return getattr(import_module(f"fewruns.{_HOME[name]}"), name)
