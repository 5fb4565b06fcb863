"""Who takes the events besides the screen, as the options ask: recorder, evidence, history, sinks."""

import argparse
import platform
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs_health import __version__
from gcs_health.cli.monitoring import Receiver, config_path
from gcs_health.errors import ConfigError
from gcs_health.mavlink.batch import FrameBatch
from gcs_health.record.evidence import EvidenceWriter, Packet, is_packet
from gcs_health.record.history_keeper import HistoryKeeper, StoreError
from gcs_health.record.recorder import Recorder
from gcs_health.sinks import parse_sink
from gcs_health.sinks.outlet import Outlet
from gcs_health.vehicle_file import load_vehicle

if TYPE_CHECKING:
    from gcs_health.record.history import History

RawTap = Callable[[FrameBatch], None]

# what decides what is said of given bytes: kept in a packet, and taken from it when it is replayed
PLAIN_OPTIONS = ("estimators", "mode", "estimate_rate")
# options that name a file -> that file's name in a packet
FILE_OPTIONS = {"vehicle": "vehicle.toml", "config": "config.toml"}


@contextmanager
def live_receivers(options: argparse.Namespace) -> Iterator[tuple[list[Receiver], RawTap | None]]:
    """Give the receivers that `live` was asked for, and what must hear of all frames.

    Raises
    ------
    ConfigError : a file or folder that they need cannot be made.
    """
    others = [*history_of(options), *sinks_of(options)]
    if not options.record:
        with evidence_of(options, None) as (receivers, raw_tap):
            yield [*receivers, *others], raw_tap
        return
    # who asks for the events under the very name that they would have beside the recording gets them once
    beside = Path(options.record).with_suffix(".jsonl")
    recorder = Recorder(options.record, lines=not options.jsonl or Path(options.jsonl) != beside)
    folder = Path(options.record) if options.evidence is None else Path(options.evidence)
    if options.evidence is None and folder.suffix == ".tlog":
        folder = folder.parent
    yield [_writer(options, folder, recorder, None), recorder, *others], recorder.write


def history_of(options: argparse.Namespace) -> list[Receiver]:
    """Give what keeps the flights' results, if asked for.

    Raises
    ------
    ConfigError : a store that was named cannot be used. The default one that cannot is only told.
    """
    if options.history == "none":
        return []

    def opens() -> "History":
        from gcs_health.record.history import History, default_url

        return History(default_url() if options.history == "default" else options.history)

    if options.history == "default":
        return [HistoryKeeper(opens)]  # SQLAlchemy loads in its thread, when the first flight ends
    try:
        opened = opens()
    except StoreError as error:
        raise ConfigError(str(error)) from None
    return [HistoryKeeper(lambda: opened)]


def sinks_of(options: argparse.Namespace, *, patient: bool = False) -> list[Receiver]:
    """Give the sinks asked for, each in its thread; `patient` ones hold back a replay that outruns them.

    Raises
    ------
    ConfigError : one is not spelled right, or lacks its package.
    """
    sinks = [parse_sink(spec) for spec in options.sink]  # all are right before the first is opened
    return [Outlet(sink, patient=patient) for sink in sinks]


@contextmanager
def evidence_of(
    options: argparse.Namespace, log: str | None
) -> Iterator[tuple[list[Receiver], RawTap | None]]:
    """Give what saves evidence if that was asked for, out of a copy of all frames beside the packets."""
    if options.evidence is None:
        yield [], None
        return
    folder = Path(options.evidence)
    with ExitStack() as stack:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            place = stack.enter_context(tempfile.TemporaryDirectory(prefix=".frames-", dir=folder))
        except OSError as error:
            raise ConfigError(f"{folder}: cannot save evidence there: {error.strerror}") from None
        recorder = Recorder(f"{place}/flight.tlog", lines=False)
        stem = "live" if log is None else "standard-input" if log == "-" else Path(log).stem
        yield [_writer(options, folder, recorder, stem), recorder], recorder.write


def _writer(
    options: argparse.Namespace, folder: Path, recorder: Recorder, stem: str | None
) -> EvidenceWriter:
    configuration: dict[str, Any] = {name: getattr(options, name) for name in PLAIN_OPTIONS}
    members = {}
    for name, member in FILE_OPTIONS.items():
        if path := config_path(options) if name == "config" else getattr(options, name):
            members[member] = Path(path).read_bytes()
            configuration[name] = member
    if options.vehicle:
        models = {Path(name).name: Path(name) for name in load_vehicle(options.vehicle).vibration_models}
        members |= {name: path.read_bytes() for name, path in models.items()}
        configuration["vibration_models"] = list(models)
    return EvidenceWriter(folder, lambda: recorder.flights, stem, configuration, members, _versions())


def _versions() -> dict[str, str]:
    parts = {name: metadata.version(name) for name in ("numpy", "scipy", "pymavlink", "fastcrc")}
    return {"gcs_health": __version__, "python": platform.python_version(), **parts}


@contextmanager
def options_for(options: argparse.Namespace, log: str) -> Iterator[argparse.Namespace]:
    """Give the options with which to replay `log`: those of a packet where it is one.

    What the user names on the command line, a vehicle file, goes before what the packet holds.
    """
    if not is_packet(log):
        yield options
        return
    packet = Packet(log)
    said = packet.manifest.get("configuration", {})
    merged = argparse.Namespace(**vars(options))
    for name in PLAIN_OPTIONS:
        if name in said:
            setattr(merged, name, tuple(said[name]) if isinstance(said[name], list) else said[name])
    if not options.config:
        merged.config = "none"  # the packet's alert was not raised under the rules of whoever replays it
    with tempfile.TemporaryDirectory() as place:
        for name, member in FILE_OPTIONS.items():
            content = packet.read(member)
            if content is not None and not getattr(options, name):
                path = Path(place) / member
                path.write_bytes(content)
                setattr(merged, name, str(path))
        for model in said.get("vibration_models", ()):
            (Path(place) / Path(model).name).write_bytes(packet.read(Path(model).name) or b"")
        yield merged
