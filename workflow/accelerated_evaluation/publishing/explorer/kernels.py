"""The compiled code of the vehicles as one module of WebAssembly, and the addresses of its arrays."""

from dataclasses import dataclass

from accelerated_evaluation.publishing.explorer.kinds import INT, ArrayOf, RecordOf
from accelerated_evaluation.publishing.explorer.translator import Translator
from accelerated_evaluation.vehicles.builtin import driver_kernel, kernel
from accelerated_evaluation.vehicles.builtin.driver_numbers import Driver

CAPACITY = 16_384  # largest number of encounters in a batch


@dataclass(frozen=True)
class Kernels:
    """The WebAssembly module, and the layout of its memory.

    Attributes
    ----------
    module
        The binary module. It exports ``car`` and ``driver``, which simulate a slice of the encounters, and
        functions for parts of a time step, such as ``car_watch``, with which the page shows an encounter over
        time.
    layout
        Addresses of the arrays in bytes, types of the fields of the records, and constants of the steps.
    """

    module: bytes
    layout: dict


def translated_kernels() -> Kernels:
    """Translate the simulations of the built-in car and of the human drivers to WebAssembly.

    Returns
    -------
    Kernels
        The WebAssembly module, and the places of its arrays in memory.

    Raises
    ------
    TranslationError
        If the code of a simulation uses a part of Python that the translator does not know.
    """
    translator = Translator()
    encounters, outcomes = ArrayOf.of(3, CAPACITY), ArrayOf.of(4, CAPACITY)
    car, driver = RecordOf.of(kernel.Car), RecordOf.of(Driver)
    states = {"car": ArrayOf.of(kernel.FIELDS, kernel.LANES)}
    states["driver"] = ArrayOf.of(driver_kernel.FIELDS, driver_kernel.LANES)
    index = ArrayOf.of(kernel.LANES, element=INT)

    translator.export("car", kernel.simulate_slice, encounters, INT, INT, car, outcomes)
    translator.export("driver", driver_kernel.follow_slice, encounters, INT, INT, driver, outcomes)
    translator.export("car_start", kernel.start, encounters, INT, INT, car, states["car"], index)
    for name in ("watch", "command", "move"):
        translator.export(f"car_{name}", getattr(kernel, name), states["car"], INT, car)
    column = ArrayOf(encounters.element, encounters.shape[:1], encounters.strides[:1])
    translator.export("driver_start", driver_kernel.start, driver, column, INT, states["driver"], INT)
    translator.export("driver_skip", driver_kernel.skip, driver, states["driver"], INT)
    for name in ("watch", "decide", "move"):
        translator.export(f"driver_{name}", getattr(driver_kernel, name), states["driver"], INT, driver)

    layout = {
        "capacity": CAPACITY,
        "encounters": translator.allocate(encounters),
        "outcomes": translator.allocate(outcomes),
        "index": translator.allocate(index),
        "car": _of_kernel(kernel, translator, car, states["car"]) | {"steps": kernel.STEPS},
        "driver": _of_kernel(driver_kernel, translator, driver, states["driver"]),
    }
    return Kernels(translator.module(), layout)


def _of_kernel(module: object, translator: Translator, record: RecordOf, state: ArrayOf) -> dict:
    """Return the addresses of a kernel's parameters and state, and the row of each state variable by name."""
    rows = {name: value for name, value in vars(module).items() if name.isupper() and isinstance(value, int)}
    return {
        "record": translator.allocate(record),
        "fields": [kind for _, kind in record.fields],
        "names": [name for name, _ in record.fields],
        "state": translator.allocate(state),
        "lanes": state.shape[1],
        "step": module.STEP,
        "rows": rows,
    }
