"""The subcommand ``export``, which writes a weighted set of scenarios."""

from dataclasses import dataclass
from pathlib import Path

from accelerated_evaluation.base.options import argument, option
from accelerated_evaluation.commands import COMMANDS
from accelerated_evaluation.commands.shared import LAW, OfLaw, given_law, refuse_options

SAFE = 1.5  # [m/s^2], cut-ins that need a smaller deceleration are assumed to be safe
DESCRIPTION = f"""\
Write a weighted set of concrete scenarios, from which anyone can compute a vehicle's crash probability.

FOLDER contains the scenarios as OpenSCENARIO XML 1.2 with their OpenDRIVE road, scenarios.csv with the
weights, and README.md, which explains how to compute the crash probability and its interval from the outcomes
of a vehicle. For scenarios other than the cut-in (--scenario), there are no OpenSCENARIO files. If the law
has draws, weights.csv has the weights under at most 100 of them.

{LAW}

example, after `make study`:
  accelerated-evaluation export cut_ins \\
      --law results/spmd/laws/draws.json --encounters results/spmd/encounters.parquet"""


@COMMANDS.add("export")
@dataclass(frozen=True)
class Export(OfLaw, description=DESCRIPTION):
    """Write a weighted set of scenarios for others to drive."""

    folder: Path = argument("FOLDER", "new folder for the set")
    size: int = option("N", "largest number of scenarios (default: %(default)s)", 300)
    safe_deceleration: float | None = option(
        "A", f"cut-ins that this deceleration avoids are assumed to be safe [m/s^2] (default: {SAFE})"
    )
    motion: str | None = option(
        None,
        "for cut-ins, let the other car change its speed as in the recordings of NGSIM (default: it keeps "
        "its speed)",
        choices=["ngsim"],
    )

    def start(self) -> None:
        """Draw the set, write it, and print its path."""
        from accelerated_evaluation.base.errors import InputError
        from accelerated_evaluation.base.randomness import child_generator
        from accelerated_evaluation.laws.motion import MOTIONS
        from accelerated_evaluation.track.export import with_motion, write_set
        from accelerated_evaluation.track.scenarios import NOT_WRITTEN, WRITERS
        from accelerated_evaluation.track.weighted_set import draw_scored_set, draw_weighted_set

        given = given_law(self)
        scenario, law = given.scenario, given.law
        generator, data = child_generator(self.seed, "export"), {}
        if given.table is None:
            refuse_options(self, scenario.name, "safe_deceleration", "motion")
        else:
            data["data"] = given.table.attrs.get("description", "not described")
        safe = self.safe_deceleration
        if law.strata:
            drawn = draw_weighted_set(law, self.size, SAFE if safe is None else safe, generator)
        elif safe is None:
            drawn = draw_scored_set(scenario, law, self.size, generator)
        else:
            raise InputError(
                "--safe-deceleration",
                seen=f"a law without strata ({law.description})",
                expected="a law of cut-ins in strata of the lead speed",
                change="Leave the option out. No cut-in is then assumed to be safe.",
            )
        if self.motion:
            drawn = with_motion(drawn, MOTIONS[self.motion](), child_generator(self.seed, "motion"))
            data["lead motion"] = (
                f"{self.motion}; cut-ins are assumed to be safe as with a constant lead speed"
            )
        origin = {
            f"law of {scenario.noun}s": law.description,
            **data,
            **{f"{name}, SHA-256": source.sha256 for name, source in given.sources.items()},
            "seed": str(self.seed),
            **dict(line.split(": ", 1) for line in given.verdict.lines()),
        }
        write_set(self.folder, drawn, origin, scenario)
        for line in [*given.verdict.lines(), *([] if scenario.name in WRITERS else [NOT_WRITTEN])]:
            print(line)
        print(f"{len(drawn.table)} scenarios: {self.folder}; read {self.folder / 'README.md'}")
