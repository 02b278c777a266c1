"""Figure 36, beyond the paper: the likeliest crash seen from above, as a moving picture."""

from collections.abc import Sequence
from pathlib import Path
from string import Template
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from accelerated_evaluation.publishing.figures.style import (
    COLUMN_WIDTH,
    Drawn,
    note_source,
    say_no_crash,
    say_unknown,
)
from accelerated_evaluation.publishing.published import figure

CAR, LANE = (4.8, 1.9), 3.5  # [m], length and width of a car, width of a lane
BEFORE = AFTER = 1.5  # [s], times before and after the crossing in which the other car moves sideways
STEP = 0.1  # [s], of the traces
SLOWER, STILL = 2, 2.5  # how many times slower than reality, and for how long [s] the end is shown
SCALE = 8  # [px/m] of the moving picture
BAR = 340  # [px], length of the bar that shows the first speed of the car under test
HOST, LEAD, BRAKES, ROAD = "#08306b", "#777777", "#c00000", "#e8e8e8"
SEEN = 90  # [m], length of road that is seen ahead of the car under test

# In pixels; the front of the car under test is at 60, and the lanes have their true width.
PICTURE = Template("""\
<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 740 232" width="740" font-family="sans-serif"
  font-size="20">
<title>$title $course</title>
<style>
.moves {animation: $length linear infinite}
$keyframes
@media (prefers-reduced-motion: reduce) {.moves {animation: none}}
</style>
<rect width="740" height="232" fill="white"/>
<text x="8" y="24">$title</text>
<text x="8" y="50">$course</text>
<rect y="62" width="740" height="70" fill="$road"/>
<path class="moves" style="animation-name:road" d="M-400 97H3000" stroke="#888888" stroke-width="2"
  stroke-dasharray="24 48"/>
<g transform="translate(60 103)">
<rect x="-38" width="38" height="15" rx="4" fill="$host"/>
<rect class="moves" style="animation-name:lead;transform:$crossing" width="38" height="15" rx="4"
  fill="$lead"/>
<rect class="moves" style="animation-name:braking" opacity="0" x="-38" width="4" height="15" fill="$brakes"/>
<path class="moves" style="animation-name:crash" opacity="0" d="M-9 -2l18 18m0 -18l-18 18" stroke="$brakes"
  stroke-width="5"/>
</g>
<text x="8" y="162">car under test, $host_speed m/s at first</text>
<text x="8" y="190">other car, $lead_speed m/s</text>
<g transform="translate(390 148)">
<rect class="moves" style="animation-name:speed" width="$host_bar" height="16" fill="$host"/>
<rect y="28" width="$lead_bar" height="16" fill="$lead"/>
</g>
<g fill="$brakes">
<text class="moves" style="animation-name:emergency" opacity="0" x="8" y="220">emergency braking</text>
<text class="moves" style="animation-name:crash" opacity="0" x="390" y="220">impact at $impact m/s</text>
</g>
</svg>
""")


def is_moving(path: Path) -> bool:
    """Return whether a file is a moving picture in SVG."""
    return path.is_file() and "@keyframes" in path.read_text(encoding="utf-8")


class MovingFigure(Figure):
    """A figure whose SVG file is a moving picture; its other files show the same at rest."""

    moving = ""  # the SVG file; empty if nothing moves

    def savefig(self, fname: Any, **settings: Any) -> None:  # noqa: ANN401
        """Save the figure, or the moving picture if the format is SVG and there is one."""
        if settings.get("format") == "svg" and self.moving:
            Path(fname).write_text(self.moving, encoding="utf-8")
        else:
            super().savefig(fname, **settings)


@figure
def fig36_cut_in(happened: pd.DataFrame, traces: pd.DataFrame, source: str) -> Drawn:
    """Draw the most probable kind of crash from above; the SVG file is a moving picture.

    The other files show four moments. Before the other car crosses into the lane, both cars are drawn with
    the speeds that they have at the crossing. The movement to the side, over `BEFORE` and `AFTER`, is drawn
    for the eye: the simulation begins at the crossing, and has no sideways movement. The data have a row for
    each time.
    """
    crashes = happened[happened["kind"] == "crash"].sort_values("probability", ascending=False, kind="stable")
    row = next(iter(crashes.to_dict("records")), None)
    scene = pd.DataFrame() if row is None else _scene(traces, row["number"])
    if scene.empty:
        drawn, axes = plt.subplots()
        say_no_crash(axes) if row is None else say_unknown(axes)
    else:
        braking = scene["time_s"][scene["emergency"] == 1]
        moments = {
            "the other car changes lane": -BEFORE,
            "the other car crosses into the lane": 0.0,
            "emergency braking begins": braking.iloc[0] if len(braking) else None,
            "crash": scene["time_s"].iloc[-1],
        }
        known = {words: time for words, time in moments.items() if time is not None}
        size = (2 * COLUMN_WIDTH, 0.5 + 0.75 * len(known))
        drawn, panels = plt.subplots(len(known), sharex=True, figsize=size, FigureClass=MovingFigure)
        for axes, (words, time) in zip(panels, known.items(), strict=True):
            _draw_moment(axes, scene.iloc[int(np.argmin(np.abs(scene["time_s"] - time)))], words)
        panels[-1].set_xlabel("distance from the front of the car under test [m]")
        drawn.moving = _moving(scene, row)
    note_source(drawn, f"simulated under a law fitted to {source}")
    return drawn, scene


def _scene(traces: pd.DataFrame, number: int) -> pd.DataFrame:
    """Return the positions and speeds of both cars over time, from before the crossing to the crash."""
    own = traces[(traces["kind"] == "crash") & (traces["number"] == number)]
    if own.empty:
        return own
    own = own.iloc[: int(np.argmin(own["range_m"])) + 1]
    start = own.iloc[0]
    earlier = pd.DataFrame({"time_s": -STEP * np.arange(round(BEFORE / STEP), 0, -1)})
    for name in ("host", "lead"):
        speed = start[f"{name}_speed_m_per_s"]
        earlier[f"{name}_speed_m_per_s"] = speed
        earlier[f"{name}_position_m"] = start[f"{name}_position_m"] + speed * earlier["time_s"]
    earlier["range_m"] = earlier["lead_position_m"] - earlier["host_position_m"]
    columns = [*earlier, "host_acceleration_m_per_s2", "emergency"]
    scene = pd.concat([earlier, own])[columns].reset_index(drop=True).fillna(0.0)
    shift = np.clip(scene["time_s"] / np.where(scene["time_s"] < 0, BEFORE, AFTER), -1, 1)
    return scene.assign(
        range_m=scene["range_m"].clip(lower=0), lead_lateral_m=LANE / 2 * (1 - np.sin(np.pi / 2 * shift))
    )


def _draw_moment(axes: Axes, now: pd.Series, words: str) -> None:
    axes.axhline(LANE / 2, color="#999999", linestyle=(0, (6, 6)), linewidth=0.8)
    for x, y, colour in ((-CAR[0], 0.0, HOST), (now["range_m"], now["lead_lateral_m"], LEAD)):
        axes.add_patch(Rectangle((x, y - CAR[1] / 2), *CAR, color=colour, linewidth=0, zorder=2))
    host, lead = (f"{now[f'{name}_speed_m_per_s']:.1f} m/s" for name in ("host", "lead"))
    time = f"{now['time_s']:.1f} s".replace("-", "−")
    title = f"{time}: {words}; car under test (dark) {host}, other car (light) {lead}"
    axes.set_title(title, fontsize=7, loc="left", pad=2)
    axes.set(xlim=(-8, SEEN), ylim=(-LANE / 2, 1.5 * LANE), yticks=[], facecolor=ROAD)
    axes.grid(visible=False)
    axes.spines["left"].set_visible(False)


def _moving(scene: pd.DataFrame, row: dict[str, Any]) -> str:
    """Return the moving picture, which plays `SLOWER` than reality and then begins again.

    Readers whose system asks for reduced motion see the moment of the crossing.
    """
    time, speed = scene["time_s"].to_numpy(), scene["host_speed_m_per_s"]
    length = SLOWER * (time[-1] - time[0]) + STILL
    share = 100 * SLOWER * (time - time[0]) / length
    places = SCALE * scene[["range_m", "lead_lateral_m"]].to_numpy()
    at = [f"translate({ahead:.1f}px,{-aside:.1f}px)" for ahead, aside in places]
    frames = [
        _track("road", share, [f"translateX({-x:.1f}px)" for x in SCALE * scene["host_position_m"]]),
        _track("lead", share, at),
        _track("speed", share, [f"scaleX({x:.4f})" for x in speed / speed.max()]),
        _appears("braking", share, scene["host_acceleration_m_per_s2"] < 0),
        _appears("emergency", share, scene["emergency"] == 1),
        _appears("crash", share, time == time[-1]),
    ]
    course = (
        f"The other car crosses {row['range']:.0f} m ahead, and the gap closes at "
        f"{row['closing_speed']:.0f} m/s."
    )
    return PICTURE.substitute(
        title=f"The likeliest crash, {SLOWER} times slower than in reality.",
        course=course,
        length=f"{length:.2f}s",
        keyframes="\n".join(frames),
        host=HOST,
        lead=LEAD,
        road=ROAD,
        brakes=BRAKES,
        crossing=at[int(np.argmin(np.abs(time)))],
        host_speed=f"{speed.max():.0f}",
        lead_speed=f"{row['lead_speed']:.0f}",
        host_bar=BAR,
        lead_bar=f"{BAR * row['lead_speed'] / speed.max():.1f}",
        impact=f"{row['impact_speed']:.1f}",
    )


def _track(name: str, share: np.ndarray, places: Sequence[str]) -> str:
    """Return an animation of CSS: where something is at each share [%] of the time, at last for the rest."""
    steps = [f"{each:.2f}% {{transform: {place}}}" for each, place in zip(share, places, strict=True)]
    return f"@keyframes {name} {{{' '.join(steps)} 100% {{transform: {places[-1]}}}}}"


def _appears(name: str, share: np.ndarray, happens: np.ndarray) -> str:
    """Return an animation of CSS: something is seen from the first time at which it happens, if it does."""
    first = float(share[np.argmax(happens)]) if np.any(happens) else 100.0
    return f"@keyframes {name} {{0%, {first - 0.01:.2f}% {{opacity: 0}} {first:.2f}%, 99.99% {{opacity: 1}}}}"
