"""The alert rules of one vehicle: the catalogue, as its user changed it, each value with where it came from.

    the catalogue  <-  what a file says for all vehicles  <-  what it says for this one

A vehicle is told by its airframe's name, by "sysid.compid" and by its autopilot's hardware id, the later the
stronger: the first two can be another's tomorrow.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from gcs_health.fusion.alert_table import CATALOGUE, OF_KIND, ROTOR_FAILED, AlertKind
from gcs_health.fusion.kinds import FAILED, Kind

# what a user may change of a code
CHANGEABLE = ("enabled", "raise_at", "clear_at", "clear_after", "hold", "latched", "severity")
DEFAULT = "default"
CRITICAL = 2  # MAV_SEVERITY from which on an alert is critical, else an advisory
ADVISORY_BUDGET, CRITICAL_BUDGET = 0.1, 0.001  # false alarms per flight hour

Setting = bool | int | float


class Change(NamedTuple):
    """One value of one code that is not the catalogue's; `vehicle` None = of all. `source`: file and key."""

    vehicle: str | None
    code: str
    key: str
    value: Setting
    source: str


class Effective(NamedTuple):
    """One value as it holds, and where it came from."""

    code: str
    key: str
    value: Setting
    source: str


@dataclass(frozen=True, slots=True)
class Rules:
    """Every code's row as it holds for one vehicle."""

    rows: dict[str, AlertKind] = field(default_factory=lambda: dict(CATALOGUE))

    @property
    def least(self) -> float:
        """The lowest probability at which anything is raised."""
        return min(row.raise_at for row in self.rows.values())

    def row(self, kind: Kind) -> AlertKind | None:
        """Return the row of a kind; None where the user wants none, a failed rotor being told as such."""
        row = self.rows[OF_KIND[kind].code]
        if not row.enabled and kind in FAILED:
            return self.failed
        return row if row.enabled else None

    @property
    def failed(self) -> AlertKind | None:
        """The row of a failed rotor of no clear kind."""
        row = self.rows[ROTOR_FAILED.code]
        return row if row.enabled else None


class RuleBook:
    """What the user changed, for all vehicles and for single ones; without changes, the catalogue."""

    def __init__(self, changes: Sequence[Change] = ()) -> None:
        self.changes = tuple(changes)

    def rules(self, *names: str | None) -> Rules:
        """Return the rules of a vehicle of these names, the weakest first."""
        rows = dict(CATALOGUE)
        for change in self._holding(names):
            settings: Any = {change.key: change.value}
            rows[change.code] = replace(rows[change.code], **settings)
        return Rules(rows)

    def effective(self, *names: str | None) -> list[Effective]:
        """Return every value that may be changed, code by code, with its source."""
        source = {(change.code, change.key): change.source for change in self._holding(names)}
        rows = self.rules(*names).rows
        return [
            Effective(code, key, getattr(row, key), source.get((code, key), DEFAULT))
            for code, row in rows.items()
            for key in CHANGEABLE
        ]

    def _holding(self, names: Sequence[str | None]) -> list[Change]:
        order: list[str | None] = [None, *(name for name in names if name)]
        return [change for name in order for change in self.changes if change.vehicle == name]
