"""Encounters per second of the compiled car, its NumPy reference and a plain-Python loop.

Run as ``python benchmarks/simulator.py``. All contenders simulate the same random encounters in the same run,
in turns, so that a change in the machine's load meets each of them; a rate is the median of its turns.
"""

import argparse
import math
import statistics
import time
from collections.abc import Callable

import numpy as np
from accelerated_evaluation.vehicles import AccAeb, Outcomes
from accelerated_evaluation.vehicles.protocol import OUTCOMES
from reference_car import simulate as simulate_by_numpy

SIZES = {"compiled, 1 core": 400_000, "compiled, 2 cores": 800_000, "NumPy": 20_000, "plain Python": 400}


def naturalistic(generator: np.random.Generator, n: int) -> np.ndarray:
    """Draw encounters that resemble recorded cut-ins: nearly all run for 8 s; shape (3, n)."""
    return _encounters(generator, n, mean_inverse_ttc=0.04)


def accelerated(generator: np.random.Generator, n: int) -> np.ndarray:
    """Draw encounters as an accelerated distribution does, with large 1/TTC: many end early; shape (3, n)."""
    return _encounters(generator, n, mean_inverse_ttc=1.5)


def _encounters(generator: np.random.Generator, n: int, *, mean_inverse_ttc: float) -> np.ndarray:
    range_ = 1 / (1 / 75 + generator.exponential(0.02, n))
    closing_speed = np.minimum(generator.exponential(mean_inverse_ttc, n) * range_, 23.49)
    return np.array([generator.uniform(5, 35, n), range_, closing_speed])


def plain_python(encounters: np.ndarray) -> Outcomes:
    """Simulate in a plain loop, one encounter after the other."""
    rows = [plain_encounter(*encounter) for encounter in encounters.T.tolist()]
    crash, *others = (np.array(column) for column in zip(*rows, strict=True))
    return Outcomes(crash, *others)


def plain_encounter(lead: float, range_: float, closing: float) -> tuple[bool, float, float, float]:
    """Simulate one encounter by the scalar model, written as its description reads."""
    speed = min(35.0, lead + closing)
    acceleration = command = last_error = timer = onset = 0.0
    on = False
    min_range, min_ttc = range_, math.inf
    for _ in range(80):
        range_rate = lead - speed
        ttc = -range_ / range_rate if range_rate else -math.inf
        if 0 < ttc < min_ttc:
            min_ttc = ttc
        was_on = on
        if 0 < ttc <= min(0.91, 0.86 + 0.05 / 24 * (3.6 * speed - 16)):
            on = True
        elif ttc > 1 or ttc < 0:
            on = False
        error = 2 - range_ / speed
        if on:
            onset, timer = (onset, timer + 0.1) if was_on else (command, 0.1)
            command = max(-10.0, onset - 16 * timer)
        else:
            last_error = 0.0 if was_on else last_error
            command = command - 38.6252446973784 * (error - last_error)
            command = command - 1.35416845633818 * 0.1 / 2 * (error + last_error)
            command = min(max(command, -5.0), 0.0 if speed >= 90 / 2.236 else 5.0)
        last_error = error
        possible = min(max(command, -9.8), 9.8)
        acceleration = min(max(possible, acceleration - 2), acceleration + 2)
        new_speed = max(0.0, speed + acceleration * 0.1)
        range_ += (lead - (speed + new_speed) / 2) * 0.1
        speed = new_speed
        min_range = min(min_range, range_)
        if range_ <= 0:
            return True, min_range, min_ttc, max(0.0, speed - lead)
        if speed == 0:
            break
    return False, min_range, min_ttc, 0.0


def contenders() -> dict[str, Callable[[np.ndarray], Outcomes]]:
    """Return what is compared, by the names in SIZES."""
    car = AccAeb()
    return {
        "compiled, 1 core": lambda encounters: car.outcomes(encounters, threads=1),
        "compiled, 2 cores": lambda encounters: car.outcomes(encounters, threads=2),
        "NumPy": lambda encounters: simulate_by_numpy(car, *encounters),
        "plain Python": plain_python,
    }


def rates(encounters: np.ndarray, rounds: int) -> dict[str, float]:
    """Return the encounters per second of every contender, the median of ``rounds`` turns each."""
    seconds = {name: [] for name in SIZES}
    for _ in range(rounds):
        for name, simulate in contenders().items():
            part = np.ascontiguousarray(encounters[:, : SIZES[name]])
            start = time.perf_counter()
            simulate(part)
            seconds[name].append(time.perf_counter() - start)
    return {name: SIZES[name] / statistics.median(times) for name, times in seconds.items()}


def check_agreement(encounters: np.ndarray) -> None:
    """Refuse to compare what does not compute the same; also compiles what is compiled."""
    results = {name: simulate(encounters) for name, simulate in contenders().items()}
    for name, outcomes in results.items():
        for outcome in OUTCOMES:
            wanted = getattr(results["NumPy"], outcome)
            np.testing.assert_allclose(getattr(outcomes, outcome), wanted, rtol=0, atol=1e-9, err_msg=name)


def main() -> None:
    """Print the rates and their ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--rounds", type=int, default=9, help="turns of each contender (default: %(default)s)"
    )
    rounds = parser.parse_args().rounds
    for mix in (naturalistic, accelerated):
        encounters = mix(np.random.default_rng(1), max(SIZES.values()))
        check_agreement(encounters[:, : SIZES["plain Python"]])
        crashes = AccAeb().outcomes(encounters, threads=1).crash.mean()
        measured = rates(encounters, rounds)
        best = measured["compiled, 1 core"]
        print(f"{mix.__name__} encounters, {crashes:.2%} crash")
        for name, rate in measured.items():
            print(f"  {name:18} {rate:12,.0f} encounters/s   1 core compiled / this = {best / rate:8.2f}")


if __name__ == "__main__":
    main()
