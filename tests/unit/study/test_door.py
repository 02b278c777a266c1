"""The mistakes of a user of Python get the same messages as mistakes in files."""

from dataclasses import asdict, dataclass, replace

import accelerated_evaluation as ae
import numpy as np
import pandas as pd
import pytest
from accelerated_evaluation.answer.consequences.injuries.tables import RISKS
from accelerated_evaluation.crash_map.maps import read_crash_map, write_crash_map
from builders import coarse_grid

GRID = coarse_grid(speeds=(5, 35, 2), ranges=(75, 2), closing=(60, 20), refinement=1)


@pytest.fixture(scope="module")
def turns():
    return ae.read_records("left_turn")


@pytest.fixture(scope="module")
def law(turns):
    return ae.LAWS["independent_variables"].fit(turns.x, turns.data.box, np.random.default_rng(1))


@pytest.fixture(scope="module")
def cut_ins():
    return ae.read_records({"data": {"sample": 2000, "spmd": {"outlier_rows": []}}})


def flags(sdv_speed_mps, turning_speed_mps, distance_to_conflict_m):
    return distance_to_conflict_m < 20


class Wanting:
    """A vehicle without a method simulate."""


class Crashing:
    """A vehicle that crashes where the lead vehicle is slow, and has too few outcomes."""

    def simulate(self, sdv_speed_mps, turning_speed_mps, distance_to_conflict_m):
        outcome_type = ae.SCENARIOS["left_turn"].outcome_type
        return outcome_type(*(np.zeros(len(sdv_speed_mps) - 1, bool) for _ in range(6)))


def too_few(lead_speed, range_, closing_speed):
    return ae.Outcomes(*(np.zeros(len(lead_speed) - 1, bool) for _ in range(4)))


def without_a_number(lead_speed, range_, closing_speed):
    outcomes = ae.load_vehicle("acc_aeb").simulate(lead_speed, range_, closing_speed)
    return replace(outcomes, min_range=outcomes.min_range * np.nan)


def at_random(lead_speed, range_, closing_speed):
    """Outcomes of the car under test for other ranges in every simulation."""
    other = range_ * np.random.default_rng().uniform(0.5, 1, len(range_))
    outcomes = ae.load_vehicle("acc_aeb").simulate(lead_speed, other, closing_speed)
    return replace(outcomes, min_range=np.minimum(outcomes.min_range, range_))


TURN, NEAR = ae.SCENARIOS["left_turn"], ae.event_named("min_range=1", "cut_in")
LONG = "a" * 300  # a longer name than file systems accept


class Unknown:
    """An object that no parameter of the public interface accepts."""


def of(vehicle, event=None):
    return ae.Problem("left_turn", vehicle, event)


def evaluated(law, **changes):
    usual = {"problem": ae.Problem("left_turn", "acc_aeb"), "draws": law, "by": ae.Simulations(200)}
    return ae.evaluate(**(usual | {"generator": 1} | changes))


# Calls with the records of left turns and their law, and what the message says of each.
REFUSED = [
    (
        lambda *_: ae.Problem("left_trun", flags),
        "expected one of cut_in, left_turn, pedestrian. Did you mean",
    ),
    (lambda *_: ae.Problem("left_turn", "acc"), "vehicle: seen 'acc'; expected acc_aeb"),
    (lambda *_: ae.Problem("left_turn", Wanting()), "seen a Wanting; expected an object with a method simul"),
    (lambda *_: ae.Problem("left_turn", Wanting), "Write Wanting()."),
    (lambda *_: ae.Problem("left_turn", flags, "impact_sped=5"), "expected crash, or impact_speed"),
    (
        lambda *_: ae.Problem("left_turn", flags, "crash", "law.json"),
        "seen 'law.json'; expected a law of the",
    ),
    (lambda _, law: evaluated(law, problem="left_turn"), "seen 'left_turn'; expected a problem. Make one"),
    (
        lambda _, law: evaluated(100),
        "argument draws: seen 100; expected draws of the law of the encounters, o",
    ),
    (lambda _, law: evaluated(law, by=ae.Simulations), "by: seen the class Simulations; expected a way"),
    (lambda _, law: evaluated(law, generator="1"), "seen '1'; expected a numpy.random.Generator, or a whole"),
    (
        lambda _, law: evaluated(law, events=["speed=5"]),
        "events: seen 'speed=5'; expected crash, or impact_s",
    ),
    (
        lambda _, law: evaluated(law, problem=ae.Problem("cut_in", "acc_aeb")),
        "law for the scenario cut_in: s",
    ),
    (
        lambda _, law: evaluated(law, problem=of(flags)),
        "vehicle flags, simulate: seen ndarray; expected Outc",
    ),
    (lambda _, law: evaluated(law, problem=of(lambda one, two: one)), "takes 2 positional arguments but 3"),
    (
        lambda _, law: evaluated(law, problem=of(Crashing())),
        "Crashing, crash: seen shape (199,); expected sh",
    ),
    (lambda *_: ae.FewRuns(stoping=ae.Stopping()), "'stoping'; expected FewRuns(stopping, batch_size"),
    (lambda *_: ae.LawStudy.of("left_turn", 5, 1), "records: seen 'left_turn'; expected records"),
    (lambda turns, _: ae.LawStudy.of(turns, 5, "1"), "streams: seen '1'; expected a seed, or a function"),
    (lambda *_: ae.map_crashes(too_few, GRID, [], 1), "too_few, crash: seen shape (39,); expected shape"),
    (lambda *_: ae.map_crashes(without_a_number, GRID, [], 1), "without_a_number, min_range[0] of the enc"),
    (lambda *_: ae.map_crashes(at_random, GRID, [], 1), "seen a vehicle whose outcomes are random"),
    (lambda *_: ae.read_records("a\0b"), "paths: seen 'a\\x00b'; expected a path that this system accepts"),
    (lambda *_: ae.load(given={"modules": [LONG]}), f"modules: seen no file {LONG} in"),
    (
        lambda *_: ae.load(given={"data": {"table": {"path": LONG}, "source": "table"}}),
        "a: seen no such file",
    ),
    (
        lambda *_: ae.load(given={"data": {"highd": {"path": LONG}, "source": "highd"}}),
        "a: seen no such fold",
    ),
    (lambda turns, _: ae.choose_draws("copula", turns), "seen 'copula'; expected answer, "),
    (lambda turns, _: ae.fit_paper_law("four", turns), "name: seen 'four'; expected one of two_pieces"),
    (lambda *_: ae.Variable("gap", "m", 9, 0, "the gap"), "Variable gap: seen limits from 9 to 0"),
    (lambda *_: ae.Box(("a", "b"), (0.0,), (1.0, 1.0)), "a lower limit below an upper limit for each"),
    (lambda *_: ae.Box(("a", "a"), (0.0, 0.0), (1.0, 1.0)), "expected different names"),
    (lambda *_: ae.Stopping(maximum_simulations=-1), "seen -1; expected a number above -1"),
    (lambda *_: ae.child_generator(1, -1), "path: seen -1; expected texts, and whole numbers"),
    (lambda *_: ae.Posterior([0.1, -0.2], [0, 1]), "negative or infinite values; expected"),
    (lambda *_: ae.Posterior([0.1, 0.2], [0]), "expected one probability and one number of a candidate"),
    (lambda *_: replace(TURN, variables=()), "Scenario left_turn: seen no variables"),
    (lambda *_: replace(TURN, variables=TURN.variables[:1] * 2), "expected a name of its own for each"),
    (
        lambda *_: replace(TURN, outcome_type=Unknown),
        "seen the outcomes Unknown; expected a frozen dataclass",
    ),
    (lambda *_: replace(TURN, scanned="distance"), "the variable distance; expected one of its variables"),
    (lambda *_: RISKS.add("cut_inn"), "scenario: seen 'cut_inn'; expected one of cut_in, "),
    (lambda *_: replace(TURN, events=()), "seen no events; expected at least one Event"),
    (lambda *_: ae.FittedRecords.of("left_turn", pd.DataFrame({"a": [1]})), "a table without sdv_speed_mps"),
    (lambda *_: of("acc_aeb").simulate(np.zeros((4, 2))), "(4, 2); expected an array of shape (n, 3) with"),
    (lambda _, law: evaluated(law, problem=of("acc_aeb", NEAR)), "seen an event scored by 'min_range'; ex"),
]


@pytest.mark.parametrize(("call", "message"), REFUSED)
def test_a_call_says_what_it_cannot_use(call, message, turns, law):
    with pytest.raises(ae.InputError) as error:
        call(turns, law)
    assert message in str(error.value)


@pytest.mark.parametrize(
    "use",
    [
        lambda problem: problem.dimension,
        lambda problem: problem.evaluate(np.zeros((2, 3))),
        lambda problem: problem.repeat(np.zeros((2, 3))),
        lambda problem: problem.coordinates(np.zeros((2, 3))),
        lambda problem: problem.fingerprint,
        lambda problem: problem.only("a stratum"),
    ],
)
def test_what_needs_a_law_says_that_the_problem_has_none(use, law):
    with pytest.raises(ae.InputError, match="Problem, argument law: seen None; expected a law of the enc"):
        use(ae.Problem("left_turn", "acc_aeb"))
    problem = ae.Problem("left_turn", "acc_aeb", law=law)
    assert problem.dimension == 3
    assert problem.evaluate(np.zeros((2, 3)))[0].shape == (2,)


def test_text_seeds_and_one_law_are_the_objects_for_which_they_stand(turns, law):
    scenario = ae.SCENARIOS["left_turn"]
    by_text, by_objects = (
        ae.evaluate(problem, draws, ae.Simulations(2_000), events, generator=generator)
        for problem, draws, events, generator in (
            (ae.Problem("left_turn", "acc_aeb", "crash"), law, ["impact_speed=5"], 7),
            (
                ae.Problem(scenario, ae.load_vehicle("acc_aeb", scenario), scenario.event("crash"), law),
                ae.OneLaw(law),
                [scenario.event("impact_speed", 5.0)],
                np.random.default_rng(7),
            ),
        )
    )
    assert by_text.table().equals(by_objects.table())
    assert by_text.table()["probability"].gt(0).all()


def test_a_function_is_a_vehicle_with_the_same_answer(law):
    car = ae.load_vehicle("acc_aeb", "left_turn")
    way, generators = ae.Simulations(2_000), (3, 3)
    first, second = (
        ae.evaluate(ae.Problem("left_turn", vehicle), law, way, generator=generator)
        for vehicle, generator in zip((car, lambda *columns: car.simulate(*columns)), generators, strict=True)
    )
    assert first.posterior.probability == second.posterior.probability


def test_an_answer_prints_four_lines_at_most(law):
    found = ae.evaluate(ae.Problem("left_turn", "acc_aeb"), law, ae.Simulations(2_000), generator=1)
    lines = repr(found).splitlines()
    assert 3 <= len(lines) <= 4
    assert lines[0].startswith("crash: probability in an encounter 0.0")
    assert "80%" in lines[1]
    assert lines[-1].startswith("6,000 simulations, converged; 1 draw of the law of")
    assert found.in_words() == repr(found)


def test_limits_that_are_auto_are_derived_from_a_users_table(tmp_path, monkeypatch):
    generator = np.random.default_rng(1)
    size = 400
    lines = ["lead_speed,range,closing_speed"]
    speeds, ranges = generator.uniform(10, 30, size), generator.uniform(5, 60, size)
    closing = generator.exponential(1.5, size)
    lines += [f"{a:.3f},{b:.3f},{c:.3f}" for a, b, c in zip(speeds, ranges, closing, strict=True)]
    (tmp_path / "mine.csv").write_text("\n".join(lines))
    monkeypatch.chdir(tmp_path)
    given = {"data": {"source": "table", "table": {"path": "mine.csv"}}}
    config = ae.load(given=given)
    assert config["filters"]["range_max"] > 40
    by_keys, by_config = ae.read_records(given), ae.read_records(config)
    assert by_keys.size == by_config.size > 100


PLACES = {"name": "gap", "unit": "m", "description": "the gap"}
DOORS = [
    (ae.child_generator, {"root_seed": 1}),
    (ae.Stopping, asdict(ae.Stopping())),
    (ae.load, {"paths": (), "given": {}}),
    (ae.read_records, {"config": "left_turn", "check": None}),
    (ae.event_named, {"text": "crash", "scenario": "left_turn"}),
    (ae.outcome, {"unit": "m", "description": "the gap", "optional": False}),
    (ae.Outcome, PLACES),
    (ae.Variable, PLACES | {"low": 0.0, "high": 9.0, "step": 1.0, "sign_matters": True}),
    (ae.Event, {"quantity": "gap", "threshold": 1.0, "happens": abs, "score": abs}),
    (ae.Event.flag, {"name": "crash", "scored_by": "gap"}),
    (ae.Event.above, {"name": "impact_speed", "threshold": 1, "scored_by": "gap"}),
    (ae.Event.at_most, {"name": "gap", "threshold": 1}),
    (ae.Box, {"names": ("a",), "lower": (0.0,), "upper": (1.0,)}),
    (
        ae.Scenario,
        {
            key: getattr(TURN, key)
            for key in ("name", "description", "variables", "outcome_type", "events", "default_vehicle")
        }
        | {"vehicles": dict(TURN.vehicles)},
    ),
    (ae.Request, {"law": "paper", "replicates": 1, "sampling_share": 0.1, "event": None, "against": None}),
    (
        ae.FewRuns,
        {"stopping": ae.Stopping(), "batch_size": 5, "share": 0.1, "predecessor": None, "on_batch": None},
    ),
    (ae.Simulations, {"size": 10}),
    (ae.Scan, {"lines": 16, "points": 20}),
    (ae.Grid, asdict(GRID)),
    (ae.Problem, {"scenario": "left_turn", "vehicle": "acc_aeb", "event": None, "law": None, "graded": True}),
    (ae.vehicles_of, {"scenario": "left_turn"}),
    (ae.Posterior, {"probabilities": [0.1, 0.2], "member": [0, 1]}),
    (ae.Replayed, {"happened": [True, False]}),
    (ae.compare, {"own": None, "other": None}),
    (ae.LAWS.add, {"name": "a_new_law"}),
    (ae.LAWS.__getitem__, {"name": "gaussian_copula"}),
]


@pytest.mark.parametrize(("door", "given"), DOORS)
def test_every_parameter_says_what_it_cannot_use(door, given):
    door(**given)
    for name in given:
        for wrong in (Unknown(), 1j, [Unknown()]):
            with pytest.raises(ae.InputError, match=r": seen .*; expected .*\. \w"):
                door(**(given | {name: wrong}))


def test_every_parameter_of_functions_of_laws_says_what_it_cannot_use(turns, law, tmp_path):
    draws, problem = ae.as_draws(law), ae.Problem("left_turn", "acc_aeb", law=law)
    found = ae.evaluate(problem, draws, ae.Simulations(3000), generator=1)
    doors = [
        (ae.as_draws, {"law": law}),
        (ae.OneLaw, {"proposal": law, "name": "a"}),
        (ae.DrawnLaws, {"parts": [draws], "own": law, "description": "one"}),
        (draws.__add__, {"other": draws}),
        (draws.thinned, {"size": 1}),
        (law.draw, {"n": 2, "generator": 1}),
        (draws.draw_from_mean, {"n": 2, "generator": 1}),
        (law.box.contains, {"x": turns.x}),
        (ae.write_law, {"path": tmp_path / "law.json", "law": law, "records": None, "verdict": None}),
        (ae.read_law, {"path": tmp_path / "law.json", "records": None}),
        (ae.FittedRecords.of, {"scenario": "left_turn", "table": turns.table, "support": None}),
        (problem.simulate, {"x": turns.x}),
        (problem.evaluate, {"z": np.zeros((2, 3))}),
        (
            ae.evaluate,
            {"problem": problem, "draws": draws, "by": ae.Simulations(3000), "events": [], "generator": 1},
        ),
        (ae.extrapolation, {"answer": found, "records": turns, "replayed": None}),
        (ae.Replayed.of, {"problem": problem, "x": turns.x}),
        (ae.Replayed([True]).supports, {"probability": 0.5}),
        (found.table, {"events_per_km": 0.1}),
        (found.budget, {"sampling_deviation": 0.1}),
        (found.posterior.interval, {"level": 0.8}),
        (found.crashes.drawn, {"size": 2, "generator": 1}),
    ]
    for door, given in doors:
        test_every_parameter_says_what_it_cannot_use(door, given)


EVENTS = [
    ({"happens": lambda outcomes: outcomes.no_such}, "function happens: seen AttributeError"),
    (
        {"happens": lambda outcomes: 1 / 0},
        "seen ZeroDivisionError: division by zero; expected a function",
    ),
    ({"happens": lambda outcomes: True}, "seen True with values such as [ True]; expected an array of flags"),
    ({"happens": lambda outcomes: outcomes.crash[:3]}, "of the shape (3000,)"),
    ({"happens": lambda outcomes: outcomes.impact_speed}, "expected an array of flags without NaN"),
    ({"score": lambda outcomes: outcomes.impact_speed * np.nan}, "function score: seen an array of shape"),
    ({"score": lambda outcomes: 0.0}, "seen 0.0 with values such as [0.]; expected an array of numbers"),
]


@pytest.mark.parametrize(("changed", "message"), EVENTS)
def test_the_functions_of_a_users_event_are_checked(changed, message, law):
    usual = {"happens": lambda outcomes: outcomes.crash, "score": lambda outcomes: outcomes.clearance}
    event = ae.Event("mine", **(usual | changed))
    problem = ae.Problem("left_turn", "acc_aeb", event, law=law)
    with pytest.raises(ae.InputError) as error:
        problem.evaluate(np.zeros((3000, 3)))
    assert message in str(error.value)


def test_draws_are_added_to_draws_and_laws_of_the_same_variables(turns, law, cut_ins):
    draws = ae.as_draws(law)
    assert (draws + law).size == (draws + draws).size == 2
    with pytest.raises(ae.InputError, match="the sum of two sets of draws: seen sdv_speed_mps"):
        draws + ae.fit_paper_law("single", cut_ins)


def test_records_and_draws_print_one_line(turns, law):
    assert repr(turns).startswith(f"{turns.size:,} records of {TURN.one}, with sdv_speed_mps, turning_")
    assert repr(ae.as_draws(law) + ae.OneLaw(law, "another")) == "2 draws of another, " + law.description


def test_a_map_of_another_scenario_is_refused_and_an_exact_answer_prints_itself(turns, law, cut_ins):
    paper = ae.fit_paper_law("two_pieces", cut_ins)
    way = ae.Map(ae.map_crashes("acc_aeb", replace(GRID, closing_speed_points=40), [], 1), cut_ins)
    exact = ae.evaluate(ae.Problem("cut_in", "acc_aeb"), paper, way, generator=1)
    assert "intervals with no uncertainty, without data and choice of law" in repr(exact)
    with pytest.raises(ae.InputError, match="Map: seen a problem of the scenario left_turn"):
        ae.evaluate(ae.Problem("left_turn", "acc_aeb"), law, way, generator=1)


LAWS = [
    ({"from_normal_scores": lambda law, z: z * np.nan}, "an array of shape (300, 3) with NaN; expected an"),
    (
        {"from_normal_scores": lambda law, z: z[:, :2]},
        "an array of shape (300, 2); expected an array",
    ),
    ({"draw": lambda law, n, generator: np.zeros((n // 2, 3))}, "an array of shape (150, 3); expected an"),
    ({"draw": lambda law: 3}, "TypeError: <lambda>() takes 1 positional argument but 3 were given; expected"),
    ({"log_density": lambda law, x: np.full((len(x), 1), np.nan)}, ", 1) with NaN; expected an array"),
    ({"log_density": lambda law, x: 0.0}, "0.0; expected an array of numbers without NaN, of the shape ("),
    ({"log_density": lambda law, x: 1 / 0}, "ZeroDivisionError: division by zero; expected a function that"),
]


@pytest.mark.parametrize(("changed", "message"), LAWS)
def test_a_law_of_a_user_is_checked_when_it_is_used(changed, message, law):
    right = {
        "box": law.box,
        "description": "mine",
        "from_normal_scores": lambda own, z: law.from_normal_scores(z),
        "log_density": lambda own, x: law.log_density(x),
        "content": lambda own: {},
        "from_content": classmethod(lambda cls, content, box, records: cls()),
    }
    problem, way = ae.Problem("left_turn", "acc_aeb"), ae.Simulations(300)
    found = ae.evaluate(problem, type("Mine", (ae.Law,), right)(), way, generator=1)
    assert found.posterior.probability == ae.evaluate(problem, law, way, generator=1).posterior.probability
    with pytest.raises(ae.InputError) as error:
        ae.evaluate(problem, type("Mine", (ae.Law,), right | changed)(), way, generator=1)
    assert str(error.value).startswith("law Mine, the function <lambda> in ")
    seen = str(error.value).partition(": seen ")[2]
    assert message in seen


@dataclass(frozen=True)
class Wagon:
    """A frozen vehicle, of which class and parameters are known."""

    headway: float = 2.0

    def simulate(self, lead_speed, range_, closing_speed):
        return ae.load_vehicle("acc_aeb", headway=self.headway).simulate(lead_speed, range_, closing_speed)


@pytest.mark.parametrize(
    ("of_map", "of_problem", "message"),
    [
        ("acc_aeb", "acc_only", "AccAeb(); expected a map of the vehicle of the problem, AccOnly()."),
        ("acc_aeb", ae.load_vehicle("acc_aeb", headway=3), "AccAeb(); expected a map of the vehicle of the "),
        (Wagon(3), Wagon(), "Wagon(headway=3.0); expected a map of the vehicle of the problem, Wagon()."),
        (Wagon(3), "acc_aeb", "Wagon(headway=3.0); expected a map of the vehicle of the problem, AccAeb()."),
        (Wagon(3), Wagon(3.0), None),
        (Wagon().simulate, "acc_aeb", None),
        ("acc_aeb", Wagon().simulate, None),
    ],
)
def test_a_map_of_another_vehicle_is_refused_even_from_a_file(tmp_path, cut_ins, of_map, of_problem, message):
    made = ae.map_crashes(of_map, GRID, [], 1)
    write_crash_map(tmp_path / "map.npz", made)
    law, problem = ae.fit_paper_law("single", cut_ins), ae.Problem("cut_in", of_problem)
    for crash_map in (made, read_crash_map(tmp_path / "map.npz")):
        way = ae.Map(crash_map, cut_ins)
        if message is None:
            assert ae.evaluate(problem, law, way, generator=1).posterior.probability >= 0
            continue
        with pytest.raises(ae.InputError) as error:
            ae.evaluate(problem, law, way, generator=1)
        assert str(error.value).startswith(f"Map, argument crash_map: seen a map of the vehicle {message}")
