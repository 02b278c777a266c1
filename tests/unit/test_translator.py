"""The translator of kernels: the binary format by hand, and code that it must refuse.

That translated code computes what Python computes is tested in a browser, in tests/workflow/test_explorer.py.
"""

import numba
import numpy as np
import pytest
from accelerated_evaluation.base.errors import StudyError
from accelerated_evaluation.publishing.explorer import vehicles, wasm
from accelerated_evaluation.publishing.explorer.kernels import translated_kernels
from accelerated_evaluation.publishing.explorer.kinds import (
    BOOL,
    FLOAT,
    INT,
    ArrayOf,
    RecordOf,
    TranslationError,
)
from accelerated_evaluation.publishing.explorer.payload import Payload, exposure_of
from accelerated_evaluation.publishing.explorer.translator import Translator
from accelerated_evaluation.vehicles.builtin.driver_numbers import Driver

TEN = 10
NAMES = ("a", "b")


@pytest.mark.parametrize(
    ("value", "encoded"),
    [(0, "00"), (63, "3f"), (64, "c000"), (-1, "7f"), (-64, "40"), (-65, "bf7f"), (-123456, "c0bb78")],
)
def test_signed_numbers_as_in_the_specification(value, encoded):
    assert wasm.signed(value).hex() == encoded


@pytest.mark.parametrize(("value", "encoded"), [(0, "00"), (127, "7f"), (128, "8001"), (624485, "e58e26")])
def test_unsigned_numbers_as_in_the_specification(value, encoded):
    assert wasm.unsigned(value).hex() == encoded


def test_a_function_by_hand():
    def twice(x):
        return x + x

    translator = Translator()
    translator.export("twice", twice, FLOAT)
    assert bytes(translator.functions[0].code).hex() == "20002000a00f00"  # get, get, add, return, unreachable
    assert translator.module()[:8] == b"\x00asm\x01\x00\x00\x00"


def test_fields_of_a_record_have_their_annotated_types():
    fields = dict(RecordOf.of(Driver).fields)
    assert (fields["rule"], fields["deceleration"], fields["forgets_ramp"]) == (INT, FLOAT, BOOL)


def test_all_kernels_are_translated_and_equal_sources_give_equal_bytes():
    first, second = translated_kernels(), translated_kernels()
    assert first.module == second.module
    assert len(first.module) < 30_000
    assert first.layout["car"]["rows"]["SPEED"] == 2


def plain(x):
    return x


@numba.njit
def compiled(x):
    return x


def power(x):
    return x**2


def floor_division(x):
    return x // 2.0


def chained(x):
    return 0.0 < x < 1.0


def calls_plain(x):
    return plain(x)


def named_argument(x):
    return compiled(x=x)


def unknown_name(x):
    return x + TWELVE  # noqa: F821


def other_constant(x):
    return NAMES


def loop_over_list(x):
    for y in [1.0, 2.0]:
        x = x + y
    return x


def loop_with_else(x):
    while x > 1.0:
        x = x / 2.0
    else:
        x = 0.0
    return x


def with_try(x):
    try:
        return x
    finally:
        pass


def bitwise_on_numbers(x):
    return x & 1.0


def truth_of_a_number(x):
    return 1.0 if x else 0.0


def changes_type(x):
    y = 1
    y = x
    return y


def two_results(x):
    if x > 0.0:
        return x
    return x, x


def comprehension(x):
    return sum([x for _ in range(3)])


def three_way_minimum(x):
    return min(x, 1.0, 2.0)


def grows(x):
    return np.zeros(3)[0] + x


REFUSED = (
    power,
    floor_division,
    chained,
    calls_plain,
    named_argument,
    unknown_name,
    other_constant,
    loop_over_list,
    loop_with_else,
    with_try,
    bitwise_on_numbers,
    truth_of_a_number,
    changes_type,
    two_results,
    comprehension,
    three_way_minimum,
    grows,
)


@pytest.mark.parametrize("function", REFUSED, ids=lambda function: function.__name__)
def test_code_outside_the_subset_is_an_error_with_its_line(function):
    with pytest.raises(TranslationError) as caught:
        Translator().export("f", function, FLOAT)
    message = str(caught.value)
    line = int(message.split("line ")[1].split(":")[0])
    first = function.__code__.co_firstlineno
    assert first < line <= first + 8
    assert function.__name__ in message


def strange_index(a, i):
    return a[0.5, i]


def missing_index(a, i):
    return a[i]


def partial_column(a, i):
    b = a[1:, i]
    return b[0]


@pytest.mark.parametrize("function", [strange_index, missing_index, partial_column])
def test_strange_indices_are_errors(function):
    with pytest.raises(TranslationError):
        Translator().export("f", function, ArrayOf.of(3, 4), INT)


def test_the_page_puts_every_slider_at_the_vehicle_of_the_study():
    tested = {"name": "acc_aeb", "parameters": {"aeb_ttc": 1.23, "aeb_release_ttc": 1.4, "headway": 1.55}}
    own = vehicles.compiled_vehicles(tested)[0]
    starts = {slider["name"]: slider["stops"][slider["start"]] for slider in own["sliders"]}
    assert starts["aeb_ttc"]["value"] == "1.23"
    assert starts["headway"]["value"] == "1.55"
    assert all(not stop["changes"] for stop in starts.values())


def test_sliders_together_give_the_numbers_of_the_vehicle():
    for described in vehicles.compiled_vehicles({"name": "other", "parameters": {}}):
        vehicle_class = vehicles.VEHICLES[described["name"]]
        base = {name: getattr(vehicle_class(), name) for name in vehicles.parameter_names(vehicle_class)}
        numbers, parameters = [float(number) for number in described["numbers"]], base
        for slider, stops in zip(vehicles.SLIDERS[described["name"]], described["sliders"], strict=True):
            for place, number in stops["stops"][-1]["changes"].items():
                numbers[place] = float(number)
            parameters = slider.parameters(parameters, slider.values(base[slider.parameter])[-1])
        assert numbers == [float(number) for number in vehicle_class(**parameters).compiled()]


def test_two_sliders_of_one_number_are_an_error(monkeypatch):
    twice = (vehicles.HEADWAY, vehicles.HEADWAY)
    monkeypatch.setitem(vehicles.SLIDERS, "acc_only", twice)
    with pytest.raises(StudyError, match="same compiled number"):
        vehicles.compiled_vehicles({"name": "acc_aeb", "parameters": {}})


def test_without_kilometres_there_are_no_rates():
    assert exposure_of(100, {"kilometres": None, "hours": 3.0})["rates"] is None
    rates = exposure_of(100, {"kilometres": 50.0})["rates"]
    assert np.mean(rates) == pytest.approx(2e6, rel=0.02)  # 100.5 cut-ins in 50 km, from 15 quantiles


def test_text_cannot_end_the_script_that_holds_it():
    payload = Payload({"study": "</script><b>"})
    payload.add("values", [1, 2], "u2")
    assert "<" not in payload.json
    bad = Payload({"bad": float("nan")})
    with pytest.raises(ValueError, match="not JSON compliant"):
        str(bad.json)
