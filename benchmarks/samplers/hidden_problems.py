"""Events of several parts, one of which a search finds easily while another one is easily missed.

All are unions of disjoint or independent sets in the space of normal scores, with exact probabilities. In the
problems whose names end in ``flags``, the sampler sees no score.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from accelerated_evaluation.base.arrays import Array
from problems import Problem, below_zero
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import ndtr
from scipy.stats import chi2, ncx2, norm

Margin = Callable[[Array], Array]  # of points z, shape (n, d); at most 0 in the part, like a distance outside


def half_space(distance: float, *direction: float) -> Margin:
    """Return the margin of a half-space; the direction has a component for each input."""
    normal = np.array(direction) / np.linalg.norm(direction)
    return lambda z: distance - z @ normal


def ball(radius: float, *centre: float) -> Margin:
    """Return the margin of a ball."""
    return lambda z: np.linalg.norm(z - np.array(centre), axis=1) - radius


def in_ball(radius: float, distance: float, dimension: int) -> float:
    """Return the probability of a ball whose centre has a distance from the origin."""
    return float(ncx2.cdf(radius**2, dimension, distance**2))


def distance_of_ball(radius: float, probability: float, dimension: int) -> float:
    """Return the distance of the centre at which a ball has a given probability."""
    return float(brentq(lambda c: math.log(in_ball(radius, c, dimension) / probability), radius, 12))


def box(low: Sequence[float], high: Sequence[float]) -> Margin:
    """Return the margin of a box."""
    return lambda z: np.maximum(np.array(low) - z, z - np.array(high)).max(axis=1)


def in_box(low: Sequence[float], high: Sequence[float]) -> float:
    """Return the probability of a box."""
    return float(np.prod(ndtr(high) - ndtr(low)))


def curved_band(depth: float, thickness: float, bend: float) -> Margin:
    """Return the margin of a band along a parabola that opens away from the origin, in two inputs."""

    def margin(z: Array) -> Array:
        beyond = -z[:, 0] - depth - bend * z[:, 1] ** 2
        return np.maximum(-beyond, beyond - thickness)

    return margin


def in_curved_band(depth: float, thickness: float, bend: float) -> float:
    """Return the probability of the band of `curved_band`."""

    def slice_at(y: float) -> float:
        near = depth + bend * y * y
        return norm.pdf(y) * (norm.sf(near) - norm.sf(near + thickness))

    return float(2 * quad(slice_at, 0, 8)[0])


def union(name: str, dimension: int, exact: float, *parts: Margin) -> Problem:
    """Return the union of parts; its score is the smallest margin, and is left out for names in ``flags``."""

    def margin(z: Array) -> Array:
        return np.minimum.reduce([part(z) for part in parts])

    graded = not name.endswith("flags")
    return Problem(name, below_zero(name, dimension, margin, graded=graded), exact=exact)


def plane_near_ball(name: str, distance: float, radius: float, *centre: float) -> Problem:
    """Return a half-space and a ball that is disjoint from it."""
    dimension = len(centre)
    exact = norm.sf(distance) + in_ball(radius, math.hypot(*centre), dimension)
    plane = half_space(distance, 1, *[0.0] * (dimension - 1))
    return union(name, dimension, float(exact), plane, ball(radius, *centre))


def plane_and_ball(name: str, dimension: int, distance: float, radius: float, ratio: float) -> Problem:
    """Return a half-space and a ball opposite, which has ``ratio`` times its probability."""
    centre = distance_of_ball(radius, ratio * norm.sf(distance), dimension)
    return plane_near_ball(name, distance, radius, -centre, *[0.0] * (dimension - 1))


def plane_and_band(name: str, distance: float, *band: float) -> Problem:
    """Return a half-space and a `curved_band` opposite."""
    exact = norm.sf(distance) + in_curved_band(*band)
    return union(name, 2, exact, half_space(distance, 1, 0), curved_band(*band))


def two_discs(name: str, *discs: tuple[float, ...]) -> Problem:
    """Return two disjoint discs, each given by its radius and its centre."""
    exact = sum(in_ball(radius, math.hypot(*centre), 2) for radius, *centre in discs)
    return union(name, 2, exact, *(ball(*disc) for disc in discs))


def orthogonal(name: str, dimension: int, *distances: float) -> Problem:
    """Return half-spaces that are orthogonal to one another."""
    axes = np.eye(dimension)
    parts = [half_space(b, *axis) for b, axis in zip(distances, axes, strict=False)]
    return union(name, dimension, 1 - float(np.prod(ndtr(distances))), *parts)


def drawn(number: int) -> Problem:
    """Return a half-space and one or two further parts that are drawn at random: their kind, size and place.

    All parts lie along different axes of a random orthonormal system, in 2 to 8 inputs. Their probabilities
    are added, which neglects at most a thousandth.
    """
    generator = np.random.default_rng(number)
    dimension, flags = int(generator.choice([2, 2, 2, 3, 3, 4, 5, 6, 8])), generator.random() < 0.5
    axes = np.linalg.qr(generator.normal(size=(dimension, dimension)))[0]
    first = float(norm.sf(generator.uniform(3.2, 4.8)))
    ends = generator.permutation([sign * axis for axis in axes.T for sign in (1, -1)])
    parts, exact = [half_space(float(norm.isf(first)), *ends[0])], first
    for end in ends[1 : generator.integers(2, 4)]:
        probability = first * math.exp(generator.uniform(math.log(0.7), math.log(3)))
        kind, size = generator.choice(["half-space", "ball", "ball", "slab"]), generator.uniform(0.6, 1.5)
        exact += probability
        if kind == "half-space":
            parts.append(half_space(float(norm.isf(probability)), *end))
        elif kind == "ball":
            radius = size * math.sqrt(dimension / 2)
            parts.append(ball(radius, *distance_of_ball(radius, probability, dimension) * end))
        else:
            across = axes[:, np.abs(axes.T @ end) < 0.5]
            depth = norm.isf(probability / math.prod([2 * norm.cdf(1.5 * size) - 1] * (dimension - 1)))
            parts.append(slab(float(depth), 1.5 * size, end, across))
    return union(f"drawn_{number}" + "_flags" * bool(flags), dimension, exact, *parts)


def slab(depth: float, width: float, end: Array, across: Array) -> Margin:
    """Return the margin of a half-space that is bounded across its axis, in directions (d, d - 1)."""
    return lambda z: np.maximum(depth - z @ end, np.abs(z @ across).max(axis=1) - width)


# Numbers of the random problems. The second ones, of which only those with scores and more than three inputs
# are used, showed that estimates of a part of the event were said to have converged. The later ones were only
# run after the method had been changed; without scores, they have at most two inputs, or none would converge.
# It was changed once more for more than three inputs, and the last ones were run after that; a third time
# before those from 340 on were run. Those from 500 on, with at most three inputs, were run after that, before
# the rule about the last prediction (`constants.REACHED`) was added.
DRAWN, SHOWN, LATER, LAST = range(100, 140), range(140, 193), range(200, 253), range(260, 420)
UNSEEN = range(500, 620)
RUNS = {
    DRAWN: "",
    SHOWN: ", that showed a fault",
    LATER: ", run later",
    LAST: ", run last",
    UNSEEN: ", run after all but the last change",
}


def has_scores(problem: Problem) -> bool:
    """Return whether the sampler sees scores."""
    return not problem.name.endswith("flags")


def group_of(problem: Problem) -> str:
    """Return the kind of a random problem, whose results are shown together, or the name of another one."""
    parts = problem.name.split("_")
    if parts[0] != "drawn":
        return problem.name
    outcome, inputs = "scores" if has_scores(problem) else "flags", problem.event.dimension
    run = next(words for numbers, words in RUNS.items() if int(parts[1]) in numbers)
    return f"{outcome}, {'4 to 8' if inputs > 3 else '2 or 3'} inputs{run}"


def hidden_problems() -> dict[str, Problem]:
    """Return all problems by name: those that showed the fault, others made by hand, and random ones."""
    squares = ([-4.0, -4.0], [-2.0, -2.0]), ([2.5, 2.5], [3.5, 3.5])
    corners = ([3.0, 3.0], [9.0, 9.0]), ([-9.0, -9.0], [-3.2, -2.8])
    sides = ([3.6], [9.0]), ([-3.7], [-3.4])
    opposite = half_space(3.8, 1, 0), half_space(4.0, -1, 0)
    ring = float(chi2.sf(4.2**2, 2) - chi2.sf(4.7**2, 2))
    everything = [
        plane_and_ball("plane_disc", 2, 4.8, 0.6, 1.0),
        plane_and_ball("plane_disc_flags", 2, 4.5, 0.9, 6.0),
        plane_and_ball("plane_large_disc", 2, 4.5, 0.9, 6.0),
        union("squares_flags", 2, sum(in_box(*square) for square in squares), *(box(*s) for s in squares)),
        plane_and_band("plane_band", 4.3, 3.9, 0.25, 0.15),
        orthogonal("planes_2_of_8", 8, 4.2, 4.2),
        orthogonal("planes_3_of_8", 8, 4.2, 4.2, 4.2),
        # The problems from here on were made afterwards, the last of them at random.
        two_discs("discs_flags", (0.8, 3.9, 0.0), (1.0, -2.5, 3.4)),
        union("ring", 2, ring, lambda z: np.abs(np.hypot(*z.T) - 4.45) - 0.25),
        union("ring_flags", 2, ring, lambda z: np.abs(np.hypot(*z.T) - 4.45) - 0.25),
        union("corners_flags", 2, sum(in_box(*corner) for corner in corners), *(box(*c) for c in corners)),
        union("sides_flags", 1, sum(in_box(*side) for side in sides), *(box(*side) for side in sides)),
        union("unequal_planes_flags", 2, norm.sf(3.8) + norm.sf(4.0), *opposite),
        plane_and_band("plane_bow_flags", 4.2, 4.4, 0.5, 0.05),
        plane_and_ball("plane_ball_3", 3, 4.2, 1.0, 1.0),
        plane_and_ball("plane_ball_3_flags", 3, 4.2, 1.5, 3.0),
        plane_and_ball("plane_ball_4", 4, 4.0, 1.5, 2.0),
        orthogonal("planes_3_of_6_flags", 6, 3.5, 3.6, 3.7),
        orthogonal("unequal_planes_4_of_5", 5, 4.0, 4.1, 4.2, 4.3),
        *map(drawn, DRAWN),
        *(each for each in map(drawn, LATER) if each.event.dimension <= 2 or has_scores(each)),
        *(each for each in map(drawn, UNSEEN) if each.event.dimension <= (3 if has_scores(each) else 2)),
        *(each for each in map(drawn, [*SHOWN, *LAST]) if each.event.dimension > 3 and has_scores(each)),
    ]
    return {problem.name: problem for problem in everything}


def problems_with_near_parts() -> dict[str, Problem]:
    """Return events with a part next to, behind or in front of the known one, by name."""
    square = [1.5, -3.6], [2.0, -3.1]
    everything = [
        plane_near_ball("disc_beside", 4.2, 0.3, 2.6, 2.3),
        plane_near_ball("disc_between", 4.2, 0.25, 3.2, 0.0),
        plane_near_ball("disc_behind", 4.2, 0.3, -3.1, -1.0),
        two_discs("two_discs", (0.5, 4.2, 0.0), (0.25, 2.6, 2.2)),
        union("square_beside", 2, norm.sf(4.3) + in_box(*square), half_space(4.3, 1, 0), box(*square)),
        plane_near_ball("ball_beside_3", 4.2, 0.5, 2.6, 2.3, 0.0),
        plane_near_ball("ball_behind_3", 4.2, 0.6, -2.0, 2.4, 1.5),
    ]
    return {problem.name: problem for problem in everything}
