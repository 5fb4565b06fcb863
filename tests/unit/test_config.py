"""The user's alert rules: what is accepted, what is refused and how, whose they are, and that alerts heed them."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from synthetic_flight import airframe

from gcs_health.calibration.false_alarms import BLOCK, level, most
from gcs_health.calibration.healthy_levels import HealthyLevels
from gcs_health.cli import main
from gcs_health.config import SCHEMA, load_config
from gcs_health.errors import ConfigError
from gcs_health.fusion.alert_table import CATALOGUE
from gcs_health.fusion.alerts import Alert, AlertDesk
from gcs_health.fusion.kinds import FAULTS, Kind
from gcs_health.fusion.rules import Rules
from gcs_health.fusion.verdicts import Verdict

HEAD = f'schema = "{SCHEMA}"\n'


def file_of(tmp_path: Path, text: str, name: str = "mine.toml") -> Path:
    path = tmp_path / name
    path.write_text(HEAD + text, encoding="utf-8")
    return path


def fed(rules: Rules, kind: Kind, p: float, times: tuple[float, ...] = (1.0,)) -> list[Alert]:
    weights = {Kind.HEALTHY: 1.0 - p, **{k: p if k is kind else 0.0 for k in FAULTS}}
    desk = AlertDesk(airframe(4), 0, rules)
    told: list[Alert] = []
    for t in times:
        verdict = Verdict(t, 0, kind, p, weights, 1.0, True, t, ())
        if desk.concerned(verdict):
            told += desk.feed(verdict)
    return told


def test_without_a_file_the_catalogue_holds_and_says_so() -> None:
    config = load_config([])
    assert config.book.rules("quad", "1.1").rows == CATALOGUE
    assert {value.source for value in config.book.effective()} == {"default"}
    assert {kind: b.rate for kind, b in config.budget().items()} == {"advisory": 0.1, "critical": 0.001}


def test_one_vehicle_goes_before_all_and_the_hardware_before_the_name(tmp_path: Path) -> None:
    path = file_of(
        tmp_path,
        "[alerts.DRAG_RISEN]\nraise_at = 0.95\nhold = 2\n"
        '[vehicle.quad.alerts.DRAG_RISEN]\nraise_at = 0.97\n[vehicle."5eed".alerts.DRAG_RISEN]\nraise_at = 0.99\n'
        "[vehicle.quad.budget]\nadvisory = 0.02\n",
    )
    config = load_config([path])
    for names, wanted in (((), 0.95), (("quad", "1.1"), 0.97), (("quad", "1.1", "5eed"), 0.99)):
        row = config.book.rules(*names).rows["DRAG_RISEN"]
        assert (row.raise_at, row.hold) == (wanted, 2.0)
    (value,) = [v for v in config.book.effective("quad") if (v.code, v.key) == ("DRAG_RISEN", "raise_at")]
    assert value.source == "mine.toml: vehicle.quad.alerts.DRAG_RISEN.raise_at"
    assert config.budget("quad")["advisory"].rate == 0.02
    assert config.budget("other")["advisory"].source == "default"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[alert.DRAG_RISEN]\n", ["mine.toml: alert", "unknown key", "'alerts'"]),
        ("[alerts.DRAG_RAISED]\n", ["alerts.DRAG_RAISED", "did you mean 'DRAG_RISEN'"]),
        ("[alerts.DRAG_RISEN]\nraise = 0.9\n", ["alerts.DRAG_RISEN.raise", "did you mean 'raise_at'"]),
        ("[alerts.DRAG_RISEN]\nraise_at = 3\n", ["alerts.DRAG_RISEN.raise_at", "up to 0.9999"]),
        ("[alerts.DRAG_RISEN]\nraise_at = 0.1\n", ["alerts.DRAG_RISEN.raise_at", "from 0.5 on"]),
        ("[alerts.DRAG_RISEN]\nclear_at = 0.95\n", ["alerts.DRAG_RISEN.clear_at", "below raise_at"]),
        ("[alerts.DRAG_RISEN]\nenabled = 1\n", ["alerts.DRAG_RISEN.enabled", "true or false"]),
        ("[alerts.DRAG_RISEN]\nseverity = 9\n", ["alerts.DRAG_RISEN.severity", "0 to 7"]),
        ("[alerts.DRAG_RISEN]\nhold = -1\n", ["alerts.DRAG_RISEN.hold", "from 0 on"]),
        ("[budget]\nadvisory = 0\n", ["budget.advisory", "above 0"]),
        (
            '[vehicle."1.1".alerts.DRAG_RISEN]\nhold = "long"\n',
            ["vehicle.1.1.alerts.DRAG_RISEN.hold", "expected a number"],
        ),
    ],
)
def test_a_bad_value_gets_one_line_that_names_file_and_key(
    tmp_path: Path, text: str, words: list[str]
) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config([file_of(tmp_path, text)])
    assert "\n" not in str(caught.value)
    assert all(word in str(caught.value) for word in ["mine.toml", *words])


def test_alerts_heed_threshold_hold_severity_and_being_switched_off(tmp_path: Path) -> None:
    text = (
        "[alerts.DRAG_RISEN]\nraise_at = 0.6\nhold = 1\nseverity = 5\n"
        "[alerts.PROPELLER_UNBALANCED]\nenabled = false\n[alerts.THRUST_LOSS]\nenabled = false\n"
    )
    rules = load_config([file_of(tmp_path, text)]).book.rules()
    assert fed(Rules(), Kind.DRAG_RISEN, 0.7, (1.0, 2.5)) == []
    (alert,) = fed(rules, Kind.DRAG_RISEN, 0.7, (1.0, 1.5, 2.5))
    assert (alert.t, alert.kind.severity) == (2.5, 5)
    assert fed(rules, Kind.PROPELLER_UNBALANCED, 0.99) == []
    # a kind that is not told by itself is still a failed rotor
    assert [a.kind.code for a in fed(rules, Kind.THRUST_LOSS, 0.99)] == ["ROTOR_FAILED"]


def test_no_alarm_in_t_hours_proves_at_most_three_over_t() -> None:
    for hours in (0.5, 10.0, 1000.0):
        assert most(0, hours) == pytest.approx(3.0 / hours, rel=0.002)
    assert most(3, 10.0) == pytest.approx(0.7754, rel=1e-3)  # Garwood: chi2(.95, 8) / 20


def test_a_level_keeps_its_budget_on_flights_it_has_not_seen() -> None:
    # odds with a tail of known law: the level for a rate is known exactly
    rng = np.random.default_rng(3)
    inside, total, rate = 0, 200, 1.0
    truth = -9.0 + 0.7 * math.log(3600.0 / BLOCK / rate)
    for _ in range(total):
        found = level((rng.exponential(0.7, 2000) - 9.0).tolist(), 0, rate)
        low, high = (math.log(p / (1.0 - p)) for p in (found.low, found.high))
        inside += low <= truth <= high
    assert 0.88 < inside / total <= 1.0  # 95 %, less what the rounding of u and m adds
    assert found.hours == pytest.approx(2000 * BLOCK / 3600.0)
    assert not found.extrapolated
    assert level([-9.0] * 2000, 0, 0.01).extrapolated
    assert level([-9.0] * 2000, 0, 0.01).raise_at != level([-9.0] * 2000, 0, 0.01).raise_at  # NaN: no tail


def test_blocks_are_of_flight_alone() -> None:
    family = frozenset({"a"})
    levels = HealthyLevels((family,))
    for k in range(300):  # 30 s, of which 4 s stand on the ground
        t = 0.1 * k
        levels.feed(t, [(family, t)], not 12.0 <= t < 16.0)
    levels.close()
    assert levels.blocks[family] == pytest.approx([10.0, 26.0])


def test_the_command_prints_every_value_with_its_source(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = file_of(tmp_path, '[vehicle."1.1".alerts.DRAG_RISEN]\nraise_at = 0.97\n')
    assert main(["config", "--config", str(path), "--of", "1.1"]) == 0
    shown = capsys.readouterr().out
    assert "0.97      mine.toml: vehicle.1.1.alerts.DRAG_RISEN.raise_at" in shown
    assert all(code in shown for code in CATALOGUE)
    assert main(["config", "--config", str(path), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert len(said["alerts"]) == 7 * len(CATALOGUE)
    assert main(["config", "--config", str(tmp_path / "gone.toml")]) == 2
    assert "gone.toml: cannot read" in capsys.readouterr().err
