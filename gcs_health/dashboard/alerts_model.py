"""The list of alerts: one entry an episode, the autopilot's words and notices between them."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

from gcs_health.dashboard.commands import SHELVE_FOR
from gcs_health.dashboard.snapshot import NAN, Entry, Level, Row
from gcs_health.dashboard.words import number
from gcs_health.fusion.alert_table import CATALOGUE, OF_KIND, ROTOR_FAILED
from gcs_health.fusion.kinds import FAILED
from gcs_health.record.events import AlertEvent, AutopilotEvent, VehicleEvent

KEPT = 300  # entries
BEFORE, AFTER = 20.0, 10.0  # s around an alert that its plots show
WORDS_WITHIN = 15.0  # s
NOTICE, INFO = 5, 6  # MAV_SEVERITY
AGAIN_US = 10_000_000  # µs within which the same notice is the same line
ARCHIVE = 40  # traces kept
FAILED_CODES = {OF_KIND[kind].code: kind.value for kind in FAILED} | {ROTOR_FAILED.code: "rotor failed"}


class EntryBook:
    """Entries by key, oldest first."""

    def __init__(self) -> None:
        self._entries: dict[str, Entry] = {}
        self._count = 0

    def copy(self) -> "EntryBook":
        """Return one that goes on by itself."""
        other = EntryBook()
        other._entries, other._count = dict(self._entries), self._count
        return other

    def alert(self, event: AlertEvent) -> None:
        """Take one step of an episode."""
        before = self._entries.get(event.id)
        figures = tuple((name, _figure(value)) for name, value in event.evidence.items())
        step = (event.t, f"{event.state} {event.code}" if event.state == "escalated" else event.state)
        if before is None:
            words = tuple(
                (entry.t, entry.text) for entry in self._entries.values() if _speaks_of(entry, event)
            )
            before = Entry(event.id, event.vehicle, event.t, event.t_unix_us, "alert", 0, "", "", words=words)
        cleared = event.state == "cleared"
        shelved = event.t + SHELVE_FOR if event.state == "shelved" else before.shelved_until
        self._put(
            replace(
                before,
                severity=event.severity,
                code=event.code,
                text=before.text if event.state in ("cleared", "acknowledged", "shelved") else event.text,
                motor=event.motor or 0,
                level=Level.FAILED if event.code in FAILED_CODES else Level.WARN,
                probability=before.probability if cleared else event.probability,
                open=not cleared,
                acknowledged=before.acknowledged or event.state == "acknowledged",
                shelved_until=NAN if event.state == "escalated" else shelved,
                steps=(*before.steps, step)[-40:],
                figures=figures or before.figures,
                advice=CATALOGUE[event.code].advice,
            )
        )

    def unshelve(self, key: str) -> None:
        """Note that an episode is to be heard of again."""
        if key in self._entries:
            self._entries[key] = replace(self._entries[key], shelved_until=NAN)

    def autopilot(self, event: AutopilotEvent) -> None:
        """Take the autopilot's word."""
        motors = ", ".join(map(str, event.motors))
        relation = {"agrees": "as we say", "alone": "we see nothing", "contradicts": "we say otherwise"}
        text = f"autopilot: {event.text} ({relation[event.relation]})"
        said = Entry(self._key(), event.vehicle, event.t, event.t_unix_us, "autopilot", 4, motors, text)
        self._put(replace(said, motor=event.motors[0] if event.motors else 0))
        for key, entry in list(self._entries.items()):
            if (
                entry.kind == "alert"
                and entry.vehicle == event.vehicle
                and abs(entry.t - event.t) < WORDS_WITHIN
            ):
                self._entries[key] = replace(entry, words=(*entry.words, (event.t, text)))

    def vehicle(self, event: VehicleEvent) -> None:
        """Take what became known of a vehicle."""
        severity = NOTICE if event.change in ("notice", "clock") else INFO
        us, text, count = event.t_unix_us, event.text, 1
        for key, entry in list(self._entries.items()):  # what is said over and over is one line
            said, _, times = entry.text.partition(" (times: ")
            again = said == text and entry.vehicle == event.vehicle and abs(us - entry.us) < AGAIN_US
            if entry.kind == "notice" and again:
                count = int(times.rstrip(")") or 1) + 1
                del self._entries[key]
        text = f"{text} (times: {count})" if count > 1 else text
        self._put(Entry(self._key(), event.vehicle, event.t, us, "notice", severity, event.change, text))

    def notice(self, text: str, us: int) -> None:
        """Take a notice of the links, the recorder or a sink."""
        self._put(Entry(self._key(), "", NAN, us, "notice", NOTICE, "program", text))

    def failed_motors(self, vehicle: str) -> dict[int, str]:
        """Return what open alerts say of motors that failed, in words."""
        return {
            entry.motor: FAILED_CODES[entry.code]
            for entry in self._entries.values()
            if entry.vehicle == vehicle and entry.open and entry.code in FAILED_CODES
        }

    def shots(self, rows: Mapping[str, Iterable[Row]]) -> tuple[Entry, ...]:
        """Return the entries, newest first, alerts with the seconds around them."""
        for key, entry in self._entries.items():
            if entry.kind != "alert" or (entry.trace and entry.trace[-1].t > entry.t + AFTER - 0.2):
                continue
            around = tuple(row for row in rows.get(entry.vehicle, ()) if -BEFORE <= row.t - entry.t <= AFTER)
            if len(around) > len(entry.trace):
                self._entries[key] = replace(entry, trace=around)
        return tuple(reversed(self._entries.values()))

    def _put(self, entry: Entry) -> None:
        self._entries[entry.key] = entry
        if len(self._entries) > KEPT:  # the oldest goes that is no open alert
            oldest = next((key for key, each in self._entries.items() if not each.open), entry.key)
            del self._entries[oldest]
        traced = [key for key, each in self._entries.items() if each.trace]
        for key in traced[: max(len(traced) - ARCHIVE, 0)]:
            self._entries[key] = replace(self._entries[key], trace=())

    def _key(self) -> str:
        self._count += 1
        return f"note-{self._count}"


def _speaks_of(entry: Entry, event: AlertEvent) -> bool:
    near = abs(entry.t - event.t) < WORDS_WITHIN
    return entry.kind == "autopilot" and entry.vehicle == event.vehicle and near


def _figure(value: object) -> str:
    if isinstance(value, float):
        return number(value, 3 if abs(value) < 100.0 else 0)
    return str(value)
