"""The smallest fault of each kind that would be seen, and where it stands."""

import math
from typing import Any

import pytest

from gcs_health.cli.text import summary_text
from gcs_health.fusion.detectable import sentence, smallest
from gcs_health.record.events import SummaryEvent
from gcs_health.report.flight_page import _rotor, _sentences

NAN = math.nan
SAID = [
    ("effectiveness", "effectiveness", 0.243),
    ("motor_observer", "effectiveness", 0.5),  # its drag, not its thrust
    ("unbalance", "unbalance", 1.234e-4),
    ("motor_observer", "drag", 0.13),
    ("pooled_ar", "degradation", 0.2),
]


def test_each_kind_by_the_estimator_that_answers_for_it() -> None:
    assert smallest(SAID) == {"thrust loss": "24 %", "unbalance": "123 g mm", "drag rise": "13 %"}


def test_what_would_not_be_seen_is_said_and_the_least_of_several_counts() -> None:
    assert sentence([("effectiveness", "effectiveness", NAN)]) == "thrust loss none"
    assert (
        sentence([("effectiveness", "effectiveness", v) for v in (NAN, 0.4, 0.2, NAN)]) == "thrust loss 20 %"
    )
    assert sentence([("unbalance", "unbalance_relative", 2e-6)]) == "unbalance 2 µm"
    assert sentence([]) == ""


@pytest.fixture
def rotor() -> dict[str, Any]:
    plain = {"t": 1.0, "value": 1.0, "std": 0.1, "failure_probability": 0.0, "status": "valid", "why": ""}
    plain |= {"balance": "", "balance_quality": NAN}
    states = [plain | {"detectable": value} for _, _, value in SAID]
    told = [
        {"estimator": e, "quantity": q, "final": state, "worst": state}
        for (e, q, _), state in zip(SAID, states, strict=True)
    ]
    head = {"motor": 1, "seat": "right", "telemetry": "fresh", "final": states[0], "worst": states[0]}
    return head | {"estimates": tuple(told)}


def test_summary_and_report_say_it_of_every_kind(rotor: dict[str, Any]) -> None:
    gaps = {"count": 0, "longest": 0.0, "total": 0.0}
    summary = SummaryEvent(1.0, 0, "1.1", 1.0, {}, gaps, {"bytes": 1}, (), (rotor,), ())  # type: ignore[arg-type]
    words = "thrust loss 24 %, unbalance 123 g mm, drag rise 13 %"
    assert f"smallest fault of a rotor that would be seen: {words}" in summary_text(summary)
    assert _rotor(rotor, {1: "healthy"})["detectable"] == words
    flight: Any = type("Flight", (), {"outcome": "healthy"})
    assert _sentences(flight, summary, [], {1: "healthy"})[1].endswith(f"{words}.")
