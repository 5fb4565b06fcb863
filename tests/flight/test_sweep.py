"""`gcs-health replay --sweep`: the edits are what they say, and a clear loss holds in all of them."""

import json
from pathlib import Path

import numpy as np
import pytest
from log_writers import samples_of
from recorded import records

from gcs_health.cli import main
from gcs_health.cli.sweep import sweep_text
from gcs_health.flight import FINDINGS, HEALTHY
from gcs_health.samples import EscStatus, Imu
from gcs_health.simulate.flight import record
from gcs_health.sweep import RECORDED, Heard, Variant, findings, variants

FLIGHT = Path(__file__).parents[2] / "replay" / "lost_propeller.tlog"


@pytest.fixture(scope="module")
def edited() -> dict[str, list[tuple[int, bytes]]]:
    return dict(variants(records(FLIGHT.read_bytes())))


def read(rows: list[tuple[int, bytes]], kind: type) -> list[tuple[object, ...]]:
    samples = samples_of(b"".join(record(*row) for row in rows))
    # an absent temperature is NaN, which equals nothing: -1 here
    return [tuple(-1.0 if v != v else v for v in s) for s in samples if type(s) is kind]


def test_phases_part_the_messages_among_them(edited: dict[str, list[tuple[int, bytes]]]) -> None:
    whole = read(edited[RECORDED], Imu)
    parts = [read(edited[f"IMU at 1/4 of its rate, phase {k}"], Imu) for k in range(4)]
    assert sorted(s for part in parts for s in part) == whole
    assert parts[1] == whole[1::4]
    escs = read(edited["rotor telemetry at 1/2 of its rate, phase 1"], EscStatus)
    assert escs == read(edited[RECORDED], EscStatus)[1::2]


def test_loss_takes_the_share_it_says(edited: dict[str, list[tuple[int, bytes]]]) -> None:
    n = len(edited[RECORDED])
    for share in (5, 20):
        kept = len(edited[f"{share} % of all frames lost, seed 1"])
        assert 1.0 - kept / n == pytest.approx(share / 100, abs=4 * (share / 100 / n) ** 0.5)


def test_shaken_stamps_stay_in_order_and_valid(edited: dict[str, list[tuple[int, bytes]]]) -> None:
    name = next(name for name in edited if name.startswith("vehicle stamps"))
    before, after = read(edited[RECORDED], Imu), read(edited[name], Imu)
    assert len(after) == len(before)  # every CRC holds
    t = np.array([s[4] for s in after])
    moved = t - np.array([s[4] for s in before])
    assert (np.diff(t) > 0).all()
    assert 0 < abs(moved).max() <= 2_000  # of 10 ms
    assert [s[5:] for s in after] == [s[5:] for s in before]


def test_a_delay_keeps_the_order(edited: dict[str, list[tuple[int, bytes]]]) -> None:
    name = next(name for name in edited if name.startswith("arrival"))
    stamps = np.array([stamp for stamp, _ in edited[name]])
    assert (np.diff(stamps) >= 0).all()
    assert [frame for _, frame in edited[name]] == [frame for _, frame in edited[RECORDED]]


def test_the_words_tell_what_holds_from_luck() -> None:
    sure, lucky = Heard("1.1", 3, "ROTOR_FAILED", 17.0), Heard("1.1", 1, "DRAG_RISEN", 9.0)
    swept = [
        Variant(RECORDED, FINDINGS, (sure, lucky), ""),
        Variant("a", FINDINGS, (sure._replace(t=17.5),), ""),
        Variant("b", FINDINGS, (sure,), ""),
    ]
    assert findings(swept)[0] == (sure, 3, 17.0, 17.5)
    text = sweep_text("flight", swept)
    assert "holds   ROTOR_FAILED of motor 3 (1.1): in 3 of 3, at 17.00 to 17.50 s" in text
    assert "luck    DRAG_RISEN of motor 1 (1.1): in 1 of 3" in text
    assert "not with: a" in text
    assert "no alert in any" in sweep_text("flight", [Variant(RECORDED, HEALTHY, (), "")])


def test_a_lost_propeller_holds_in_all(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def few(rows: list[tuple[int, bytes]]) -> list[tuple[str, list[tuple[int, bytes]]]]:
        wanted = (
            RECORDED,
            "IMU at 1/2",
            "rotor telemetry at 1/4 of its rate, phase 2",
            "5 % of all",
            "arrival",
        )
        some = [next(pair for pair in variants(rows) if pair[0].startswith(name)) for name in wanted]
        assert len(some) == 5
        return some

    import gcs_health.sweep

    monkeypatch.setattr(gcs_health.sweep, "variants", few)
    code = main(
        ["replay", str(FLIGHT), "--sweep", "--fail-on-alert", "--estimators", "effectiveness", "--jsonl", "-"]
    )
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert len(rows) == 5
    for row in rows:  # raised, and known as what it is soon after
        assert [(a["motor"], a["code"]) for a in row["alerts"]] == [
            (3, "ROTOR_FAILED"),
            (3, "PROPELLER_LOST"),
        ]
    assert all(row["outcome"] == "findings" for row in rows)
    assert code == 3
