"""The mistakes of a user of Python get the same messages as mistakes in files."""

from dataclasses import replace

import accelerated_evaluation as ae
import numpy as np
import pytest

GRID = ae.Grid(
    lead_speed_min=5,
    lead_speed_max=35,
    range_max=75,
    lead_speed_cells=2,
    range_cells=2,
    refinement=1,
    closing_speed_max=60,
    closing_speed_points=20,
)


@pytest.fixture(scope="module")
def turns():
    return ae.read_records("left_turn")


@pytest.fixture(scope="module")
def law(turns):
    return ae.LAWS["independent_variables"].fit(turns.x, turns.data.box, np.random.default_rng(1))


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


PROBLEMS = [
    (
        ("left_trun",),
        "seen 'left_trun'; expected one of cut_in, left_turn, pedestrian. Did you mean left_turn?",
    ),
    (
        (3,),
        "Problem, argument scenario: seen 3; expected a scenario, or its name: cut_in, left_turn, pedestrian",
    ),
    (("left_turn", "acc"), "vehicle: seen 'acc'; expected acc_aeb"),
    (
        ("left_turn", Wanting()),
        "argument vehicle: seen a Wanting; expected an object with a method simulate(sdv_sp",
    ),
    (("left_turn", Wanting), "seen the class Wanting; expected"),
    (("left_turn", Wanting), "Write Wanting()."),
    (
        ("left_turn", flags, "impact_sped=5"),
        "argument event: seen 'impact_sped=5'; expected crash, or impact_speed",
    ),
    (("left_turn", flags, 5), "argument event: seen 5; expected an event, or text such as"),
    (
        ("left_turn", flags, "crash", "law.json"),
        "argument law: seen 'law.json'; expected a law of the encounters",
    ),
]


@pytest.mark.parametrize(("given", "message"), PROBLEMS)
def test_a_problem_says_what_it_cannot_use(given, message):
    with pytest.raises(ae.InputError) as error:
        ae.Problem(*(given if len(given) > 1 else (*given, flags)))
    assert message in str(error.value)


EVALUATIONS = [
    ({"problem": "left_turn"}, "evaluate, argument problem: seen 'left_turn'; expected a problem. Make one"),
    (
        {"draws": 100},
        "evaluate, argument draws: seen 100; expected draws of the law of the encounters, or a law",
    ),
    ({"by": ae.Simulations}, "argument by: seen the class Simulations; expected a way"),
    (
        {"generator": "1"},
        "argument generator: seen '1'; expected a numpy.random.Generator, or a whole number",
    ),
    ({"generator": 1.5}, "seen 1.5"),
    ({"events": ["speed=5"]}, "events: seen 'speed=5'; expected crash, or impact_speed"),
    (
        {"problem": ae.Problem("cut_in", "acc_aeb")},
        "the law for the scenario cut_in: seen sdv_speed_mps from 0",
    ),
    (
        {"problem": ae.Problem("left_turn", flags)},
        "vehicle flags, simulate: seen ndarray; expected Outcomes with",
    ),
    (
        {"problem": ae.Problem("left_turn", lambda speed, other: speed)},
        "takes 2 positional arguments but 3 were",
    ),
    (
        {"problem": ae.Problem("left_turn", Crashing())},
        "vehicle Crashing, crash: seen shape (199,); expected shape",
    ),
]


@pytest.mark.parametrize(("changed", "message"), EVALUATIONS)
def test_an_evaluation_says_what_it_cannot_use(changed, message, law):
    usual = {
        "problem": ae.Problem("left_turn", "acc_aeb"),
        "draws": law,
        "by": ae.Simulations(200),
        "generator": 1,
    }
    with pytest.raises(ae.InputError) as error:
        ae.evaluate(**(usual | changed))
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda turns: ae.Simulations(0),
            "Simulations, argument size: seen 0; expected a whole number of 1 or more",
        ),
        (lambda turns: ae.FewRuns(batch_size=2.5), "FewRuns, argument batch_size: seen 2.5"),
        (lambda turns: ae.FewRuns(100), "argument stopping: seen 100; expected a stopping rule"),
        (lambda turns: ae.LawStudy.of(turns, 0, 1), "argument size: seen 0"),
        (
            lambda turns: ae.LawStudy.of("left_turn", 5, 1),
            "argument records: seen 'left_turn'; expected records",
        ),
        (
            lambda turns: ae.LawStudy.of(turns, 5, "1"),
            "argument streams: seen '1'; expected a seed, or a function",
        ),
        (
            lambda turns: ae.Map(turns, turns),
            "Map, argument crash_map: seen a FittedRecords; expected a crash map",
        ),
        (lambda turns: ae.map_crashes("acc_aeb", 8, [], 1), "argument grid: seen 8; expected a grid"),
        (lambda turns: ae.map_crashes("acc", GRID, [], 1), "vehicle: seen 'acc'"),
        (
            lambda turns: ae.map_crashes(too_few, GRID, [], 1),
            "vehicle too_few, crash: seen shape (39,); expected shape",
        ),
        (
            lambda turns: ae.map_crashes(without_a_number, GRID, [], 1),
            "vehicle without_a_number, min_range[0] of the enc",
        ),
        (lambda turns: ae.map_crashes(at_random, GRID, [], 1), "seen a vehicle whose outcomes are random"),
        (
            lambda turns: ae.read_records(3),
            "argument config: seen 3; expected a configuration, a file with one, or",
        ),
        (lambda turns: ae.read_records("mine.yaml"), "mine.yaml: seen"),
        (lambda turns: ae.choose_draws("copula", turns), "seen 'copula'; expected answer, "),
        (
            lambda turns: ae.fit_paper_law("four", turns),
            "argument name: seen 'four'; expected one of two_pieces",
        ),
        (lambda turns: ae.load_vehicle("acc_aeb", "turn"), "seen 'turn'"),
    ],
)
def test_other_functions_say_what_they_cannot_use(call, message, turns):
    with pytest.raises(ae.InputError) as error:
        call(turns)
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


def test_a_map_of_another_scenario_is_refused_and_an_exact_answer_prints_itself():
    cut_ins = ae.read_records({"data": {"sample": 2000, "spmd": {"outlier_rows": []}}})
    paper = ae.fit_paper_law("two_pieces", cut_ins)
    way = ae.Map(ae.map_crashes("acc_aeb", replace(GRID, closing_speed_points=40), [], 1), cut_ins)
    exact = ae.evaluate(ae.Problem("cut_in", "acc_aeb"), paper, way, generator=1)
    assert "intervals with no uncertainty, without data and choice of law" in repr(exact)
    turns = ae.read_records("left_turn")
    law = ae.choose_draws("independent_variables", turns)
    with pytest.raises(ae.InputError, match="Map: seen a problem of the scenario left_turn"):
        ae.evaluate(ae.Problem("left_turn", "acc_aeb"), law, way, generator=1)
