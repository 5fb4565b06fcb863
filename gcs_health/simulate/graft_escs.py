"""Telemetry faults of one ESC, as autopilots send them: exact edits of ESC_STATUS, ESC_INFO, ESC_TELEMETRY_x.

    lost     PX4: zeros, its online bit off. ArduPilot: all as it last was, the speed 0 after a second
    frozen   all as it last was, counters included
    swapped  two ESCs' values exchanged: the rows of a log, or the wires on the bench

Source: mavlink.md sections 3 and 4.
"""

from typing import Any

from gcs_health.mavlink.dialect import Dialect
from gcs_health.samples import EscInfo, EscStatus, EscTelemetry
from gcs_health.simulate.graft_fault import GraftFault
from gcs_health.simulate.recording import Recorded, unpacked

Slot = dict[str, Any]
AP_SILENT = 1.0  # s after which ArduPilot says 0 rpm


class TelemetryFault:
    """Edits the frames of one vehicle's ESCs; `remember` those before the fault, `fields` those in it.

    Parameters
    ----------
    fault : of effect "telemetry".
    esc, other : ESC indices of its motors; `other` -1 where there is none.
    """

    def __init__(self, dialect: Dialect, fault: GraftFault, esc: int, other: int) -> None:
        self._dialect, self._fault = dialect, fault
        self._esc, self._other = esc, other
        self._held: dict[tuple[str, int], Slot] = {}  # by kind of message and ESC index

    def remember(self, record: Recorded) -> None:
        """Take a frame before the fault."""
        kind, fields, first = self._opened(record)
        for k in range(4):
            self._held[kind, first + k] = _slot(fields, k)

    def fields(self, record: Recorded, since: float) -> Slot:
        """Return the fields of a frame `since` seconds into the fault."""
        kind, fields, first = self._opened(record)
        lost = self._fault.how == "lost"
        if lost and "info" in fields:
            _go_offline(fields, self._esc, first)
        if self._fault.how == "swapped":
            self._swap(kind, fields, first)
        elif first <= self._esc < first + 4:
            k = self._esc - first
            if lost and kind != "ardupilot":
                _put(fields, k, _nothing(_slot(fields, k)))
                return fields
            _put(fields, k, self._held.get((kind, self._esc), {}))
            if lost and since > AP_SILENT:
                fields["rpm"][k] = 0
        return fields

    def _opened(self, record: Recorded) -> tuple[str, Slot, int]:
        sample = record.sample
        assert isinstance(sample, EscStatus | EscInfo | EscTelemetry)
        kind = "ardupilot" if isinstance(sample, EscTelemetry) else type(sample).__name__
        return kind, unpacked(self._dialect.messages[record.message], record.raw), sample.index

    def _swap(self, kind: str, fields: Slot, first: int) -> None:
        """Exchange two ESCs; one in another batch gives what it last said there."""
        fresh = {first + k: _slot(fields, k) for k in range(4)}
        for esc, source in ((self._esc, self._other), (self._other, self._esc)):
            said = fresh.get(source) or self._held.get((kind, source))
            if esc in fresh and said is not None:
                _put(fields, esc - first, said)
        self._held.update({(kind, esc): slot for esc, slot in fresh.items()})


def _slot(fields: Slot, k: int) -> Slot:
    """Return one ESC's share of a batch's fields."""
    return {name: value[k] for name, value in fields.items() if isinstance(value, list) and len(value) == 4}


def _put(fields: Slot, k: int, slot: Slot) -> None:
    for name, value in slot.items():
        fields[name][k] = value


def _nothing(slot: Slot) -> Slot:
    """Return what PX4 says of an ESC that it has lost; its error count and last failure stay."""
    return {name: value if name in ("error_count", "failure_flags") else 0 for name, value in slot.items()}


def _go_offline(fields: Slot, esc: int, first: int) -> None:
    """Take the ESC's online bit off: older PX4 counts bits from ESC 0 in every batch, the newest from its first."""
    bit = esc if fields["info"] >> 4 else esc - first
    if 0 <= bit < 8:
        fields["info"] &= ~(1 << bit)
