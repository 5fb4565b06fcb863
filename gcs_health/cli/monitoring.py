"""What `replay` and `live` share: the monitor from the options, and where its events go."""

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self, TextIO

from gcs_health.airframe import Airframe
from gcs_health.cli.text import alert_line, clock, maintenance, notice_line, summary_text
from gcs_health.config import load_config
from gcs_health.errors import ConfigError
from gcs_health.mavlink.batch import FrameBatch
from gcs_health.monitor_config import Tap
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.append_file import AppendFile
from gcs_health.record.events import (
    AlertEvent,
    ConditionEvent,
    Event,
    SummaryEvent,
    VehicleEvent,
    to_json,
)
from gcs_health.vehicle_file import load_vehicle

if TYPE_CHECKING:
    from gcs_health.estimators.pooled_ar_model import PooledModel

KEY_LENGTH = 32


def make_monitor(
    options: argparse.Namespace,
    *,
    stamped: bool,
    raw_tap: Callable[[FrameBatch], None] | None = None,
    tap: Tap | None = None,
) -> Monitor:
    """Return a monitor as the options ask; `raw_tap` hears of all frames, `tap` of all readings.

    Raises
    ------
    AirframeError, ConfigError : a file named in the options cannot be used.
    """
    return Monitor(replace(monitor_config(options), stamped=stamped, raw_tap=raw_tap, tap=tap))


def monitor_config(options: argparse.Namespace) -> MonitorConfig:
    """Return what the options ask of a monitor.

    Raises
    ------
    AirframeError, ConfigError : a file named in the options cannot be used.
    """
    path = config_path(options)
    airframe = load_vehicle(options.vehicle) if options.vehicle else None
    return MonitorConfig(
        airframe=airframe,
        estimators=options.estimators,
        mode=options.mode,
        estimate_rate=options.estimate_rate,
        keys=(_key(options.signing_key),) if options.signing_key else (),
        rules=load_config([path] if path else []).book,
        vibration_models=_models(airframe) if "pooled_ar" in options.estimators else (),
    )


def _models(airframe: Airframe | None) -> tuple["PooledModel", ...]:
    if airframe is None or not airframe.vibration_models:
        return ()
    from gcs_health.estimators.pooled_ar_file import load

    alarms = dict(airframe.vibration_alarms)
    models = []
    for path in map(Path, airframe.vibration_models):
        model, own = load(path), alarms.get(path.name)
        models.append(model if own is None else model.alarmed(own))
    return tuple(models)


def config_path(options: argparse.Namespace) -> Path | None:
    """Return the user's file of alert rules: the one named, else the one in the settings folder; None = none."""
    if options.config == "none":
        return None
    if options.config:
        return Path(options.config)
    from platformdirs import user_config_path

    path = user_config_path("gcs-health", appauthor=False) / "config.toml"
    return path if path.exists() else None


def _key(path: str) -> bytes:
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the signing key: {error.strerror}") from None
    if len(data) == KEY_LENGTH:
        return data
    try:
        key = bytes.fromhex(data.decode("ascii").strip())
    except ValueError:
        key = b""
    if len(key) != KEY_LENGTH:
        raise ConfigError(
            f"{path}: expected a signing key of 32 bytes or 64 hex digits, got {len(data)} bytes"
        )
    return key


class Receiver(Protocol):
    """Whoever else takes the events: a recorder, a store, a sink. `notices` are told and emptied."""

    @property
    def notices(self) -> list[str]:
        """What is to be told."""
        ...

    def take(self, events: Sequence[Event]) -> None:
        """Take events; never raises for want of a disk, a server or a network."""
        ...

    def poll(self, now_us: int) -> None:
        """Do what time alone causes, at UNIX µs."""
        ...

    def close(self) -> None:
        """End of the session."""
        ...


class Output:
    """Writes events: JSON lines where asked, text for people, and to its receivers. A context manager.

    Attributes
    ----------
    raised : whether any alert was raised.
    vehicles : summaries seen.
    receivers : closed with the output, in their order.

    Text goes to standard output, or to standard error where the JSON lines have standard output; or to `text`.
    `tell` takes what is to be told besides, line by line; standard error, if nobody else does.
    """

    def __init__(
        self,
        jsonl: str | None,
        receivers: Iterable[Receiver] = (),
        text: TextIO | None = None,
        tell: Callable[[str], None] | None = None,
    ) -> None:
        self.receivers = list(receivers)
        self.raised = False
        self.vehicles = 0
        self._first = True
        self._piped = jsonl == "-"
        self._file = AppendFile(Path(jsonl), overwrite=True) if jsonl and not self._piped else None
        self.text = text or (sys.stderr if self._piped else sys.stdout)
        self.tell = tell or _to_standard_error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is not None:
            self._file.close()
            self._tell(self._file.notices)
        self._close(self.receivers)

    @property
    def lost(self) -> bool:
        """Whether JSON lines were left out for want of a disk."""
        return self._file is not None and bool(self._file.waiting or self._file.lost)

    @contextmanager
    def joined_by(self, receivers: Sequence[Receiver]) -> Iterator[None]:
        """Take in receivers for a while, then close them."""
        before = self.receivers
        self.receivers = [*receivers, *before]
        try:
            yield
        finally:
            self.receivers = before
            self._close(receivers)

    def poll(self, now_us: int) -> None:
        """Let receivers do what time alone causes, at UNIX µs."""
        for receiver in self.receivers:
            receiver.poll(now_us)
            self._tell(receiver.notices)

    def write(self, events: Sequence[Event], *, at_once: bool) -> None:
        """Write events; `at_once` prints alerts and notices as they come (else the summary has them)."""
        if events:
            self._write_lines(events)
            for receiver in self.receivers:
                receiver.take(events)
        for event in events:
            self._print(event, at_once)

    def _print(self, event: Event, at_once: bool) -> None:
        if isinstance(event, SummaryEvent):
            self.vehicles += 1
            print(summary_text(event), file=self.text, flush=True)
            return
        if isinstance(event, AlertEvent):
            self.raised |= event.state == "raised"
        if not at_once:
            return
        if isinstance(event, AlertEvent):
            print(alert_line(event), file=self.text, flush=True)
        elif isinstance(event, VehicleEvent):
            print(notice_line(event), file=self.text, flush=True)
        elif isinstance(event, ConditionEvent):
            for row in event.indicators:
                if isinstance(row, dict) and row["grows"]:
                    print(f"{clock(event.t)}  {maintenance(row)}", file=self.text, flush=True)

    def _write_lines(self, events: Sequence[Event]) -> None:
        if self._file is None and not self._piped:
            return
        text = "".join(to_json(event, self._first and k == 0) + "\n" for k, event in enumerate(events))
        self._first = False
        if self._file is not None:
            self._file.append(text.encode(), events[-1].t_unix_us)
            self._tell(self._file.notices)
        else:
            print(text, end="", flush=True)

    def _close(self, receivers: Iterable[Receiver]) -> None:
        for receiver in receivers:
            receiver.close()
            self._tell(receiver.notices)

    def _tell(self, notices: list[str]) -> None:
        for notice in notices:
            self.tell(notice)
        notices.clear()


def _to_standard_error(notice: str) -> None:
    print(f"gcs-health: {notice}", file=sys.stderr, flush=True)
