"""A vehicle as a configuration names it, with the settings of its simulations."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Any, Self

from accelerated_evaluation.base.tables import require_file
from accelerated_evaluation.scenarios.protocol import Scenario
from accelerated_evaluation.vehicles.external.checked import CheckedVehicle, ForeignVehicle
from accelerated_evaluation.vehicles.external.slow import PENDING, SimulationSettings, SlowVehicle
from accelerated_evaluation.vehicles.external.store import store_of
from accelerated_evaluation.vehicles.external.workers import Elsewhere, Processes, workers_of
from accelerated_evaluation.vehicles.loading import load_vehicle, vehicles_of
from accelerated_evaluation.vehicles.moving import takes_motion
from accelerated_evaluation.vehicles.protocol import Vehicle


@dataclass(frozen=True)
class NamedVehicle:
    """A vehicle that is loaded by its name."""

    name: str  # as for `load_vehicle`
    parameters: Mapping[str, Any]
    further_files: Sequence[str]  # on which it depends, in addition to the files that define it
    deterministic: bool | None  # None if this is unknown and has to be tested
    scenario: Scenario
    simulations: SimulationSettings

    @classmethod
    def of(
        cls,
        section: Mapping[str, Any],
        simulations: Mapping[str, Any],
        scenario: Scenario,
        **changes: Any,  # noqa: ANN401
    ) -> Self:
        """Return the vehicle of a section of the configuration.

        ``simulations`` is the section with this name, or those of its keys that differ from their defaults.
        ``changes`` replace keys of it, such as the number of workers.
        """
        settings = SimulationSettings.of({**simulations, **changes})
        given = section["name"], section["parameters"], section["files"], section.get("deterministic")
        return cls(*given, scenario, settings)

    @property
    def is_stored(self) -> bool:
        """Whether its outcomes are stored: those of commands, FMUs and, if asked, classes of the user."""
        if ":" in self.name:
            return self.simulations.keep_class
        return issubclass(vehicles_of(self.scenario)[self.name], ForeignVehicle)

    def pending(self, batch_size: int) -> int:
        """Return how many runs of an estimate may be pending; 1 if batches alone keep all workers busy.

        It depends on the workers that are configured, not on those that are used, so that the same
        configuration gives the same runs.
        """
        most = PENDING * self.simulations.workers
        return most if self.is_stored and most > batch_size else 1

    @property
    def files(self) -> list[str]:
        """All files on which the vehicle depends.

        They are the further files, of which InputError is raised if one is missing, and those that define the
        vehicle: the file of a class, the FMU, or the files that a command names. Files that these load
        are not included.
        """
        for file in self.further_files:
            require_file(file, "Correct vehicle.files.")
        if ":" in self.name:
            return [self.name.rpartition(":")[0], *self.further_files]
        car = self.load()
        own = map(str, car.vehicle.files) if isinstance(car, CheckedVehicle) else ()
        return [*own, *self.further_files]

    def load(self) -> Vehicle:
        """Return the vehicle; InputError is raised if there is none with this name and these parameters."""
        car = load_vehicle(self.name, self.scenario, **self.parameters)
        if isinstance(car, CheckedVehicle) and self.deterministic is not None:
            car.deterministic = self.deterministic
        return car

    @contextmanager
    def loaded(self, *, is_tested: bool = True, sets_aside: bool = False) -> Iterator[Vehicle]:
        """Yield the vehicle, as a `SlowVehicle` if its outcomes are stored; see there for ``sets_aside``.

        Workers are ended after the ``with`` block. Unless ``is_tested``, no encounter of a user's vehicle is
        simulated again to find out whether it is deterministic. InputError is raised if the vehicle cannot be
        loaded, if a file does not exist, or if the workers cannot be started. If the block is interrupted
        from the keyboard, the KeyboardInterrupt says how many outcomes are kept.
        """
        # The vehicle is loaded here in any case, so that errors are raised before a worker starts.
        car, files = self.load(), self.files
        if self.is_stored:
            with self._on_workers(car, files, is_tested=is_tested, sets_aside=sets_aside) as slow:
                yield slow
            return
        with Processes(1) as other:  # it starts with the first repetition
            if isinstance(car, CheckedVehicle):
                car.elsewhere = Elsewhere(self.name, self.parameters, self.scenario, other)
                car.was_repeated = not is_tested
            yield car

    @contextmanager
    def _on_workers(self, car: CheckedVehicle, files: Sequence[str], **own: bool) -> Iterator[SlowVehicle]:
        """Yield the vehicle with its store and with workers."""
        store, settings = store_of(self.name, self.parameters, files, self.scenario), self.simulations
        with workers_of(settings.executor, settings.workers, settings.options) as workers:
            if getattr(
                car.vehicle, "stays", False
            ):  # its start is expensive, and perhaps no licence is left for another one
                workers = replace(workers, others=workers.executor)
            try:
                yield SlowVehicle(
                    self.name,
                    self.parameters,
                    car.name,
                    store,
                    workers,
                    batch_size=settings.batch_size,
                    time_limit=settings.time_limit,
                    retries=settings.retries,
                    scenario=self.scenario,
                    deterministic=car.deterministic,
                    takes_motion=takes_motion(car),
                    **own,
                )
            except KeyboardInterrupt as stop:
                raise KeyboardInterrupt(
                    f"{len(store):,} outcomes are kept in {store.path}. The same command continues with "
                    "them; only the runs that were under way are lost"
                ) from stop


@contextmanager
def all_loaded(
    sections: Mapping[str, Mapping[str, Any]],
    simulations: Mapping[str, Any],
    scenario: Scenario,
    **changes: Any,  # noqa: ANN401
) -> Iterator[dict[str, Vehicle]]:
    """Yield the vehicles of several sections by label, loaded as by `NamedVehicle.of` and `loaded`."""
    with ExitStack() as stack:
        named = {k: NamedVehicle.of(each, simulations, scenario, **changes) for k, each in sections.items()}
        yield {label: stack.enter_context(each.loaded()) for label, each in named.items()}
