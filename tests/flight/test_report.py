"""`gcs-health report`: one page that needs nothing else, looked at by a real browser at two widths."""

import re
from pathlib import Path

import numpy as np
import pytest
from page_browser import measured, needs_browser

from gcs_health import MonitorConfig, replay
from gcs_health.cli import main
from gcs_health.report.drawing import airframe_svg
from gcs_health.report.flight_page import flight_page
from gcs_health.report.page import print_to_pdf
from gcs_health.report.plots import thinned
from gcs_health.report.spectrum import folded, spectrogram

FLIGHT = Path(__file__).parents[2] / "replay" / "lost_propeller.tlog"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "flight.html"
    assert main(["report", str(FLIGHT), "-o", str(path), "--estimators", "effectiveness,unbalance"]) == 0
    return path


def body(page: Path) -> str:
    text = page.read_text(encoding="utf-8")
    return text[text.index("<body>") :]


def test_the_page_says_the_verdict_first_and_names_no_other_place(page: Path) -> None:
    text = body(page)
    assert text.index("motor 3 (front left, CW): propeller lost") < text.index("<h2>Rotors")
    for part in ("Alerts", "Over the flight", "What could not be estimated", "Data quality", "Configuration"):
        assert f"<h2>{part}" in text
    assert "numpy" in text
    assert not re.search(r'(src|href)="', text)


@needs_browser
def test_a_browser_draws_every_plot_within_the_width(page: Path, tmp_path: Path) -> None:
    said = measured(page, (390, 1200), tmp_path)
    assert set(said) == {390, 1200}
    for width, seen in said.items():
        assert seen["plots"] >= 5
        assert seen["drawn"] == seen["plots"]
        assert seen["width"] <= width
        assert seen["widest"] <= width
        assert seen["requests"] == []


@needs_browser
def test_the_page_goes_onto_paper(page: Path, tmp_path: Path) -> None:
    print_to_pdf(page, tmp_path / "flight.pdf")
    assert (tmp_path / "flight.pdf").read_bytes().startswith(b"%PDF")


def test_what_was_not_known_is_said_and_a_name_cannot_smuggle_markup(tmp_path: Path) -> None:
    short = tmp_path / "<b>short.tlog"
    short.write_bytes(FLIGHT.read_bytes()[:40_000])
    text = flight_page(replay(short, MonitorConfig(estimators=("effectiveness", "motor_observer"))))
    assert "could not be judged" in text
    assert "<strong>drag</strong> of motor 1, 2, 3, 4" in text
    assert "<b>short" not in text


def test_a_line_that_is_thinned_keeps_its_extremes() -> None:
    t = np.arange(100_000) * 0.01
    y = np.sin(t)
    y[54_321] = 9.0
    x, kept = thinned(t, y)
    assert len(x) <= 1500
    assert kept.max() == 9.0
    assert (np.diff(x) > 0).all()


def test_a_tone_above_half_the_rate_lies_where_folded_says() -> None:
    t = np.arange(0.0, 20.0, 0.01)  # 100 Hz
    wave = np.sin(2.0 * np.pi * 117.0 * t)
    found = spectrogram(t, np.stack([wave, 0.01 * wave, 0.0 * wave], axis=1))
    assert found is not None
    peak = found.frequency[found.level[:, found.level.shape[1] // 2].argmax()]
    assert peak == pytest.approx(folded(np.array([117.0]), found.rate)[0], abs=1.0)
    assert peak == pytest.approx(17.0, abs=1.0)


def test_a_gap_is_no_part_of_the_spectrogram() -> None:
    t = np.arange(0.0, 20.0, 0.01)
    t = t[(t < 8.0) | (t > 12.0)]
    found = spectrogram(t, np.random.default_rng(1).standard_normal((len(t), 3)))
    assert found is not None
    inside = (found.t > 8.6) & (found.t < 11.4)
    assert np.isnan(found.level[:, inside]).all()
    assert np.isfinite(found.level[:, found.t < 7.0]).all()


def test_the_drawing_says_each_state_in_words() -> None:
    rotors = tuple(
        {"motor": k + 1, "position": (x, y, 0.0), "spin": "cw", "seat": "somewhere"}
        for k, (x, y) in enumerate([(1, 1), (1, -1), (-1, 1), (-1, 1)])  # the last two on one arm
    )
    svg = airframe_svg({"name": "a <quad>", "rotors": rotors}, {1: "fault", 2: "healthy"})
    assert svg.count("? unknown") == 2
    assert "✕ fault" in svg
    assert "✓ healthy" in svg
    assert "<quad>" not in svg
