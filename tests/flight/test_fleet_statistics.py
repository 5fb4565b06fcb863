"""What stands out in a fleet: found where it was put, and rarely where nothing was."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gcs_health.cli import main
from gcs_health.fleet import Analysed
from gcs_health.fleet_statistics import Value, growing, normalised, odd_flights, odd_rotors, odd_seats
from gcs_health.fleet_store import FleetStore

DAY = 86_400_000_000
Change = Callable[[str, int, int, float], float]


def fleet(
    seed: int, change: Change = lambda aircraft, motor, flight, value: value, flights: int = 8
) -> list[Value]:
    """Twelve aircraft of four rotors: unbalance [kg m] that grows with speed, differs a little, and is noisy."""
    rng = np.random.default_rng(seed)
    values = []
    for a in range(12):
        name, own = f"a{a:02d}", rng.normal(0.0, 1e-7, 4)
        weight = rng.normal(0.0, 0.1)
        for f in range(flights):
            speed = 600.0 * float(np.exp(weight + rng.normal(0.0, 0.05)))
            for m in range(1, 5):
                value = 2e-6 + own[m - 1] + 2e-6 * np.log(speed / 600.0) + rng.normal(0.0, 5e-8)
                value = change(name, m, f, value)
                values.append(
                    Value(name, m, f"f{f}", (1 + f) * DAY, "unbalance", "unbalance", value, 1e-7, speed)
                )
    return values


def test_the_regime_is_taken_out() -> None:
    before = fleet(1)
    after = normalised(before)
    speed = np.log([v.mean_speed for v in before])
    assert np.corrcoef(speed, [v.value for v in before])[0, 1] > 0.8
    assert abs(np.corrcoef(speed, [v.value for v in after])[0, 1]) < 0.15


def test_two_odd_rotors_are_found_and_no_others() -> None:
    odd = {("a03", 2), ("a07", 4)}
    found = odd_rotors(fleet(2, lambda a, m, f, v: v + 1e-6 if (a, m) in odd else v))
    assert {(x.aircraft, x.motor) for x in found} == odd
    for x in found:
        assert x.low > 0.0
        assert x.difference == pytest.approx(1e-6, abs=4e-7)  # its own spread among the others is 1e-7
        assert x.q < 0.05


def test_a_seat_that_is_odd_on_every_aircraft_is_found() -> None:
    found = odd_seats(fleet(3, lambda a, m, f, v: v + 2e-7 if m == 3 else v))
    assert found[0].motor == 3
    assert found[0].low < 2e-7 < found[0].high


def test_a_flight_unlike_the_others_is_found() -> None:
    found = odd_flights(fleet(4, lambda a, m, f, v: v + 1e-6 if (a, m, f) == ("a05", 1, 6) else v))
    assert [(x.aircraft, x.motor, x.flight) for x in found] == [("a05", 1, "f6")]


def test_a_rotor_that_wears_is_found_with_its_date() -> None:
    values = fleet(5, lambda a, m, f, v: v + 2e-7 * f if (a, m) == ("a08", 2) else v)
    (found,) = [g for g in growing(values) if (g.aircraft, g.motor) == ("a08", 2)]
    assert found.trend.low < 2e-7 < found.trend.high
    assert found.trend.due_us is not None
    assert found.trend.due_us > 8 * DAY


@pytest.mark.parametrize("compare", [odd_rotors, odd_seats, odd_flights])
def test_a_fleet_in_which_nothing_is_odd_rarely_has_findings(
    compare: Callable[[list[Value]], list[object]],
) -> None:
    # with all nulls true the false discovery rate is the rate of fleets with any finding: 5 % at most, so that
    # of 20 more than 4 would come by chance with a probability below 0.3 %
    with_any = sum(bool(compare(fleet(seed, flights=6))) for seed in range(100, 120))
    assert with_any <= 4


def test_the_page_names_what_stands_out(tmp_path: Path) -> None:
    values = fleet(2, lambda a, m, f, v: v + 1e-6 if (a, m) == ("a03", 2) else v)
    store = FleetStore(tmp_path / "out")
    rotors = [
        v._asdict() | {"log": f"{v.aircraft}/{v.flight}.tlog", "samples": 9, "valid": 9, "status": "valid"}
        for v in values
    ]
    flights = [
        {"log": f"a{a:02d}/f{f}.tlog", "key": "k", "outcome": "healthy", "aircraft": f"a{a:02d}", "flight": f"f{f}",
         "duration": 600.0, "version": "1", "config": "c"}
        for a in range(12) for f in range(8)
    ]  # fmt: skip
    flights.append(
        {"log": "broken.tlog", "key": "k", "outcome": "unusable", "error": "broken.tlog: no MAVLink"}
    )
    store.add(Analysed(flights, rotors, [], []))
    store.flush()
    page = tmp_path / "fleet.html"
    assert main(["fleet", "report", str(tmp_path / "out"), "-o", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    text = text[text.index("<body>") :]
    assert "a03 motor 2 stands out from its sisters" in text
    assert "Fleet of 12 aircraft" in text
    assert "16.0 h" in text
    assert "broken.tlog: no MAVLink" in text
    assert main(["fleet", "report", str(tmp_path / "nowhere"), "-o", str(page)]) == 2
