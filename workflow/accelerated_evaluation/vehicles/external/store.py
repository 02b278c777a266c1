"""A store of the outcomes of a slow vehicle, so that no encounter is simulated twice.

If the outcomes are random, an encounter is simulated several times. Every outcome is stored with the number
of the simulation of this encounter, counted from 0, so that the same sequence of requests always gets the
same outcomes.
"""

import math
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.base.files import content_digest, value_digest, write_json
from accelerated_evaluation.scenarios import DEFAULT
from accelerated_evaluation.scenarios.protocol import Scenario

VEHICLES_FOLDER = Path("results/vehicles")
PATIENCE = 600.0  # [s], longest time to wait while another process writes

Encounter = tuple[float, ...]
Outcome = tuple[float, ...]
Request = tuple[Encounter, int]  # an encounter, and the number of the simulation

DETERMINISTIC, VARIES = "deterministic", "varies"


class _Statements:
    """SQL statements for the tables of a scenario; names of columns are quoted."""

    def __init__(self, scenario: Scenario) -> None:
        inputs = [f'"{name}"' for name in scenario.names]
        outcomes = [f'"{name}"' for name in scenario.outcome_names]
        # An optional outcome that the vehicle does not have is NaN, which SQLite stores as NULL.
        self.optional = [f'"{each.name}" REAL' for each in scenario.outcomes if each.optional]
        needed = [f'"{each.name}"' for each in scenario.outcomes if not each.optional]
        needed = [f"{name} REAL NOT NULL" for name in (*inputs, *needed)]
        numbers = ", ".join([*needed, *self.optional])
        condition = " AND ".join(f"{name} = ?" for name in inputs)
        marks = ", ".join("?" for _ in (*inputs, *outcomes))
        self.tables = f"""
            CREATE TABLE IF NOT EXISTS outcomes ({numbers}, PRIMARY KEY ({", ".join(inputs)})) WITHOUT ROWID;
            CREATE TABLE IF NOT EXISTS repeats (number INTEGER NOT NULL, {numbers},
                PRIMARY KEY ({", ".join(inputs)}, number)) WITHOUT ROWID;
            CREATE TABLE IF NOT EXISTS verdicts (verdict TEXT PRIMARY KEY) WITHOUT ROWID;
        """
        self.look_up = f"SELECT {', '.join(outcomes)} FROM outcomes WHERE {condition}"
        self.look_up_repeat = f"SELECT {', '.join(outcomes)} FROM repeats WHERE {condition} AND number = ?"
        self.add = f"INSERT OR IGNORE INTO outcomes VALUES ({marks})"
        self.add_repeat = f"INSERT OR IGNORE INTO repeats VALUES (?, {marks})"


class Store:
    """Outcomes of one vehicle by encounter, in an SQLite file that several processes may use simultaneously.

    Numbers are stored exactly: an encounter is found if all its numbers are equal, and outcomes are returned
    without rounding. When `add` returns, the outcomes are on the disk. The file is created with its folder if
    necessary. InputError is raised if the file is not a store, or is damaged.
    """

    def __init__(self, path: str | os.PathLike, scenario: Scenario) -> None:
        self.path, self._sql = Path(path), _Statements(scenario)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self._connected() as connection:
            connection.executescript(self._sql.tables)
            for table in ("outcomes", "repeats"):  # of a scenario that had no such outcome before
                known = {row[1] for row in connection.execute(f"PRAGMA table_info({table})")}
                for column in self._sql.optional:
                    if column.split('"')[1] not in known:
                        connection.execute(f"ALTER TABLE {table} ADD COLUMN {column}")

    def known(self, requests: Iterable[Request]) -> dict[Request, Outcome]:
        """Return the stored outcomes of pairs of an encounter and the number of its simulation, from 0."""
        found = {}
        with self._connected() as connection:
            for encounter, number in requests:
                look_up = self._sql.look_up_repeat if number else self._sql.look_up
                asked = (*encounter, number) if number else encounter
                found[encounter, number] = connection.execute(look_up, asked).fetchone()
        return {
            request: tuple(math.nan if value is None else value for value in outcome)
            for request, outcome in found.items()
            if outcome is not None
        }

    def add(self, requests: Sequence[Request], outcomes: Sequence[Outcome]) -> None:
        """Store the outcomes of requests, in the same order.

        A request is a pair of an encounter and the number of its simulation, counted from 0.

        Outcomes that another process has stored in the meantime are not replaced.
        """
        rows = [
            (number, *encounter, *outcome)
            for (encounter, number), outcome in zip(requests, outcomes, strict=True)
        ]
        first, repeats = [row[1:] for row in rows if not row[0]], [row for row in rows if row[0]]
        with self._connected() as connection:
            connection.executemany(self._sql.add, first)
            connection.executemany(self._sql.add_repeat, repeats)

    @property
    def verdict(self) -> bool | None:
        """Whether repeated simulations had the same outcomes; None if this was not tested."""
        with self._connected() as connection:
            verdicts = {row[0] for row in connection.execute("SELECT verdict FROM verdicts")}
        return None if not verdicts else VARIES not in verdicts

    def set_verdict(self, *, deterministic: bool) -> None:
        """Save whether repeated simulations had the same outcomes.

        A saved result that outcomes differ remains valid, whatever is saved later.
        """
        verdict = DETERMINISTIC if deterministic else VARIES
        with self._connected() as connection:
            connection.execute("INSERT OR IGNORE INTO verdicts VALUES (?)", (verdict,))

    def __len__(self) -> int:
        """Return the number of encounters that were simulated at least once."""
        with self._connected() as connection:
            return connection.execute("SELECT count(*) FROM outcomes").fetchone()[0]

    @contextmanager
    def _connected(self) -> Iterator[sqlite3.Connection]:
        """Yield a connection; all changes are written at the end of the block, or none after an error."""
        try:
            with closing(sqlite3.connect(self.path, timeout=PATIENCE)) as connection, connection:
                yield connection
        except sqlite3.Error as error:
            raise InputError(
                str(self.path),
                seen=f"{error}",
                expected="a store of outcomes that can be read and written",
                change="Free disk space or correct the permissions. Delete the file only if it is damaged, "
                "because its encounters are then simulated again.",
            ) from error


def store_of(name: str, parameters: Mapping[str, Any], files: Sequence[str], scenario: Scenario) -> Store:
    """Return the store of a vehicle, in a folder whose name contains a digest of the vehicle's definition.

    If a parameter or the content of a file changes, the vehicle gets another folder. Studies with the same
    vehicle share one folder. The file ``vehicle.json`` in the folder describes the vehicle. ``files`` are the
    paths of the files that define the vehicle.
    """
    described = {"vehicle": name, "parameters": dict(parameters), "content": content_digest(files)}
    if scenario.name != DEFAULT:  # no entry for cut-ins, so that stores of version 0.2 remain valid
        described["scenario"] = scenario.name
    folder = VEHICLES_FOLDER / f"{Path(name.replace(':', '/')).name}-{value_digest(described)[:10]}"
    store = Store(folder / "outcomes.sqlite", scenario)
    write_json(folder / "vehicle.json", described)
    return store
