"""`gcs-health campaign`: seeds to rates with intervals, by the fleet's engine."""

import json
import math
from pathlib import Path

import pytest

from gcs_health.campaign import Seen, rates
from gcs_health.cli import main


def seen(seed: int, named: int = 3, motor: int = 3, early: int = 0, healthy: float = 360.0) -> Seen:
    return Seen(
        seed, motor, 17.0, named, "X" if named else "", 0.1 * seed if named else math.nan, early, healthy
    )


def test_rates_count_what_was_found_misnamed_and_false() -> None:
    said = rates([*(seen(k) for k in range(1, 9)), seen(9, named=1), seen(10, named=0)])
    assert (said.faulty, said.found, said.wrong, said.early) == (10, 8, 1, 0)
    assert said.found_interval == pytest.approx((0.490, 0.943), abs=0.002)  # Wilson's of 8 of 10
    assert said.delay == pytest.approx((0.45, 0.73))
    assert said.hours == pytest.approx(1.0)
    assert said.early_most == pytest.approx(3.0, abs=0.01)  # the rule of three
    assert rates([seen(1, early=1)]).early_most == pytest.approx(47.4, abs=0.1)  # 4.74 / 0.1 h


def test_a_campaign_flies_its_seeds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "campaign.jsonl"
    command = ["campaign", "lost_propeller", "--seeds", "31-32", "--workers", "2", "--jsonl", str(out)]
    assert main([*command, "--estimators", "effectiveness"]) == 0
    assert "lost_propeller: 2 flights" in capsys.readouterr().out
    head, *rows = [json.loads(line) for line in out.read_text().splitlines()]
    assert head["schema"] == "gcs_health.campaign/1"
    assert [row["seed"] for row in rows] == [31, 32]
    assert all(row["motor"] == 3 and row["at"] == 17.0 for row in rows)
    assert all(row["healthy"] == 12.0 for row in rows)


def test_a_scenario_or_seeds_that_cannot_be_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["campaign", "no_such"]) == 2
    with pytest.raises(SystemExit):
        main(["campaign", "lost_propeller", "--seeds", "9-3"])
    assert "expected seeds as 1-20" in capsys.readouterr().err
