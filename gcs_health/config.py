"""The user's own file: alert rules and budgets, for all vehicles and for single ones, every value with its source.

schema = "gcs_health.config/1"
[budget]                        # false alarms per flight hour that are bearable
advisory = 0.1
critical = 0.001
[alerts.DRAG_RISEN]             # any of the catalogue's codes
raise_at = 0.95
[vehicle."1.1".alerts.DRAG_RISEN]
enabled = false
[vehicle.quad.budget]           # by the airframe's name, "sysid.compid" or the autopilot's hardware id
advisory = 0.02
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from gcs_health.checked import Table
from gcs_health.fusion.alert_table import CATALOGUE, AlertKind
from gcs_health.fusion.rules import (
    ADVISORY_BUDGET,
    CRITICAL_BUDGET,
    DEFAULT,
    Change,
    RuleBook,
    Setting,
)

SCHEMA = "gcs_health.config/1"
LEAST_RAISE, MOST_RAISE = 0.5, 0.9999  # a coin's toss is no alarm; 1 is never reached
LONGEST = 600.0  # s to hold or to clear after
BUDGETS = {"advisory": ADVISORY_BUDGET, "critical": CRITICAL_BUDGET}


class Budget(NamedTuple):
    """One bearable rate of false alarms [1/h of flight], and where it came from."""

    kind: str  # "advisory" or "critical"
    rate: float
    source: str


@dataclass(frozen=True, slots=True)
class Config:
    """All that the user's files say, the later file the stronger.

    Attributes
    ----------
    book : alert rules.
    budgets : (vehicle or None = all, budget), in the order in which they were said.
    """

    book: RuleBook = field(default_factory=RuleBook)
    budgets: tuple[tuple[str | None, Budget], ...] = ()

    def budget(self, *names: str | None) -> dict[str, Budget]:
        """Return the budgets of a vehicle of these names, the weakest first."""
        found = {kind: Budget(kind, rate, DEFAULT) for kind, rate in BUDGETS.items()}
        for name in (None, *(name for name in names if name)):
            found |= {budget.kind: budget for vehicle, budget in self.budgets if vehicle == name}
        return found

    def vehicles(self) -> list[str]:
        """Return the vehicles for which anything is said."""
        said = [change.vehicle for change in self.book.changes] + [vehicle for vehicle, _ in self.budgets]
        return list(dict.fromkeys(name for name in said if name))


def load_config(paths: Sequence[str | Path]) -> Config:
    """Read and check the user's files.

    Raises
    ------
    ConfigError : one line: "mine.toml: alerts.DRAG_RISEN.raise_at: expected a number up to 0.9999, got 3".
    """
    changes: list[Change] = []
    budgets: list[tuple[str | None, Budget]] = []
    for path in paths:
        file = Table.read(Path(path))
        file.schema(SCHEMA)
        _section(file, None, Path(path).name, "", changes, budgets)
        vehicles = file.table("vehicle")
        for name in vehicles.keys():  # noqa: SIM118, a Table is no dict
            at = f"vehicle.{name}."
            row = vehicles.table(name)
            _section(row, name, Path(path).name, at, changes, budgets)
            row.done()
        file.done()
    config = Config(RuleBook(changes), tuple(budgets))
    for vehicle in (None, *config.vehicles()):
        _consistent(config.book, vehicle)
    return config


def _section(
    section: Table,
    vehicle: str | None,
    file: str,
    at: str,
    changes: list[Change],
    budgets: list[tuple[str | None, Budget]],
) -> None:
    """Read `budget` and `alerts` of all vehicles or of one."""
    row = section.table("budget")
    for kind in BUDGETS:
        if kind in row:
            budgets.append((vehicle, Budget(kind, row.positive(kind), f"{file}: {at}budget.{kind}")))
        row.value(kind, None)
    row.done()
    alerts = section.table("alerts")
    for code in CATALOGUE:
        row = alerts.table(code)
        for key, read in _READ.items():
            if key in row:
                changes.append(Change(vehicle, code, key, read(row), f"{file}: {at}alerts.{code}.{key}"))
            row.value(key, None)
        row.done()
    alerts.done()


def _consistent(book: RuleBook, vehicle: str | None) -> None:
    """Complain where values that are each fine do not go together."""
    sources = {(each.code, each.key): each.source for each in book.effective(vehicle)}
    for code, row in book.rules(vehicle).rows.items():
        if row.clear_at >= row.raise_at:
            said = next(s for key in ("clear_at", "raise_at") if (s := sources[code, key]) != DEFAULT)
            file, _, key = said.partition(": ")
            Table({}, file).fail(
                key, f"clear_at {row.clear_at:g} must be below raise_at {row.raise_at:g}, or it never clears"
            )


def _severity(row: Table) -> Setting:
    value = row.integer("severity")
    if value > 7:
        row.fail("severity", f"expected MAV_SEVERITY, 0 to 7, got {value}")
    return value


_READ = {
    "enabled": lambda row: row.flag("enabled"),
    "raise_at": lambda row: row.number("raise_at", least=LEAST_RAISE, most=MOST_RAISE),
    "clear_at": lambda row: row.number("clear_at", least=0.0, most=MOST_RAISE),
    "clear_after": lambda row: row.number("clear_after", least=0.0, most=LONGEST),
    "hold": lambda row: row.number("hold", least=0.0, most=LONGEST),
    "latched": lambda row: row.flag("latched"),
    "severity": _severity,
}
assert set(_READ) <= set(AlertKind.__slots__)
