"""One variable of an encounter, with its unit, its limits and its description."""

from dataclasses import dataclass

from accelerated_evaluation.base.arguments import a_number
from accelerated_evaluation.base.checking import checked
from accelerated_evaluation.base.errors import InputError

UNLIMITED = 1e6  # limits this large are not mentioned in texts


@checked(low=a_number(), high=a_number(), step=a_number(0))
@dataclass(frozen=True)
class Variable:
    """One variable of an encounter.

    Attributes
    ----------
    name
        Name of its column in tables, such as ``sdv_speed_mps``.
    unit
        Unit of the variable.
    low, high
        Smallest and largest value that can be simulated (both included), in this unit.
    description
        Description of the variable.
    sign_matters
        Whether the outcome depends on the sign of the variable. If it does not, laws are fitted to the
        absolute value. Values near zero are then in a tail of the law, where a sampler in normal scores finds
        events more easily.
    step
        Smallest step, in this unit, by which the variable can be set in a real run.

    Examples
    --------
    >>> import accelerated_evaluation as ae
    >>> gap = ae.Variable("gap", "m", 0.0, 100.0, "distance to the car in front")
    >>> gap.in_words
    '0 to 100 m'
    """

    name: str
    unit: str
    low: float
    high: float
    description: str
    sign_matters: bool = True
    step: float = 0.1

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise InputError(
                f"Variable {self.name}",
                seen=f"limits from {self.low:g} to {self.high:g}",
                expected="a smallest value below the largest value",
                change="Correct low or high.",
            )

    @property
    def in_title(self) -> str:
        """Return the name of the variable as text without the unit at its end, such as ``sdv speed``."""
        unit = self.unit.replace("/s", "ps")
        return self.name.removesuffix(f"_{unit}").replace("_", " ")

    @property
    def label(self) -> str:
        """Return the label of an axis; bars around the name say that the values are absolute values."""
        name = self.in_title.replace("sdv", "vehicle")  # the self-driving vehicle, which is under test
        return f"{name if self.sign_matters else f'|{name}|'} [{self.unit}]"

    @property
    def in_words(self) -> str:
        """Return the limits as text, such as ``0 to 30 m/s``; only the unit if the variable has no limits."""
        is_limited = max(abs(self.low), abs(self.high)) < UNLIMITED
        return f"{self.low:g} to {self.high:g} {self.unit}" if is_limited else self.unit
