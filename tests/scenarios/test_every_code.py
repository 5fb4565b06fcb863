"""Every code of the catalogue, and every gate, from bytes: a simulated flight through the monitor."""

import math

import pytest

from gcs_health.fusion.alert_table import CATALOGUE
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.encoder import Encoder
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent
from gcs_health.simulate.flight import Flight
from gcs_health.simulate.scenario import load_scenario

QUICK = ["trajectory.height=3", "trajectory.lands=false", "physics_rate=500"]
HEXA = [*QUICK, "vehicle=melczer_hexa", "trajectory.kind=hover"]
MOTOR = 3  # of the scenario's fault


def alerts(scenario: str, changes: list[str]) -> list[AlertEvent]:
    """Fly; return every step of every alert."""
    monitor = Monitor(MonitorConfig())
    events = []
    for stamp, frame in Flight(load_scenario(scenario, changes)).run():
        events += monitor.feed(frame, stamp)
    return [event for event in events if isinstance(event, AlertEvent)]


def struck(kind: str, at: float, until: float, *changes: str, size: float | None = None) -> list[str]:
    sized = [f"fault.0.size={size}"] if size is not None else []
    return [f"fault.0.kind={kind}", f"fault.0.at={at}", f"trajectory.duration={until}", *sized, *changes]


FAST = ["telemetry.rates.HIGHRES_IMU=250", "sensors.imu_integration_rate=250"]
SHAKEN = [*QUICK, "vehicle=ghalamchi_medium", "trajectory.kind=random", "wind.speed=5", *FAST]
FLIGHTS = {
    ("ROTOR_FAILED", "PROPELLER_LOST"): struck("propeller_lost", 8, 9.5, *HEXA),
    ("MOTOR_STOPPED",): struck("motor_stopped", 8, 9, *QUICK),
    ("ROTOR_FAILED", "MOTOR_STUCK"): struck("motor_stuck", 8, 9, *QUICK),
    ("ROTOR_FAILED", "PROPELLER_SLIPPING"): struck("slipping", 8, 9, *QUICK, size=0.1),
    ("ROTOR_FAILED", "THRUST_LOSS"): struck("effectiveness", 8, 11, *HEXA, size=0.6),
    ("PROPELLER_UNBALANCED",): struck("unbalance", 1, 9, *SHAKEN, size=200),
    ("DRAG_RISEN",): struck("bearing", 10, 21, *HEXA, "telemetry.rates.ESC_INFO=0", size=30),
    ("ESC_TELEMETRY_LOST",): struck("esc_lost", 6, 8.5, *QUICK),
    ("ESC_FAULT_REPORTED",): struck("esc_flags", 6, 6.5, *QUICK, size=1),
    ("ESC_OVERHEATING",): struck("esc_heat", 6, 6.5, *QUICK, size=120),
    ("ESC_MISATTRIBUTED",): struck("esc_swapped", 1, 11, *QUICK, size=1),
    ("MOTOR_ORDER_WRONG",): struck("esc_swapped", 1, 8, *QUICK, "telemetry.rates.SERVO_OUTPUT_RAW=0", size=1),
}


@pytest.mark.parametrize("codes", FLIGHTS, ids="-".join)
def test_the_fault_is_told_once_by_its_code_and_its_motor(codes: tuple[str, ...]) -> None:
    said = alerts("lost_propeller", FLIGHTS[codes])
    assert {alert.id for alert in said} == {"1.1-1"}  # one episode
    assert [alert.state for alert in said if alert.state == "raised"] == ["raised"]
    assert said[-1].code == codes[-1]
    assert {alert.code for alert in said} <= set(codes)
    exchanged = {1, MOTOR} if codes[-1] in ("ESC_MISATTRIBUTED", "MOTOR_ORDER_WRONG") else {MOTOR}
    assert {alert.motor for alert in said} <= exchanged
    at = float(next(c for c in FLIGHTS[codes] if c.startswith("fault.0.at")).split("=")[1])
    assert said[0].t - 5.0 > at  # the vehicle has been on for 5 s when the flight begins
    assert all(len(alert.text) <= 80 for alert in said)


def test_no_code_is_left_out() -> None:
    assert {code for codes in FLIGHTS for code in codes} == set(CATALOGUE)


def test_an_esc_that_will_be_too_hot_soon_is_told_before_it_is() -> None:
    changes = struck("esc_heat", 6, 20, *QUICK, "fault.0.ramp=40", "trajectory.kind=hover", size=150)
    (alert, *_) = alerts("lost_propeller", changes)
    assert (alert.code, alert.motor) == ("ESC_OVERHEATING", MOTOR)
    assert 70.0 < alert.evidence["esc_info.temperature_degc"] < 110.0


def test_a_rotor_that_the_controller_switched_off_is_no_second_fault() -> None:
    said = alerts("lost_propeller", struck("propeller_lost", 8, 14, *HEXA))
    assert {(alert.id, alert.motor) for alert in said} == {("1.1-1", MOTOR)}


def test_take_off_wind_and_landing_give_no_alarm() -> None:
    changes = ["trajectory.height=3", "trajectory.duration=16", "wind.speed=6", "physics_rate=500"]
    assert not alerts("healthy_quad", changes)


def test_saturation_gives_no_alarm() -> None:
    hard = ["trajectory.kind=aggressive", "trajectory.duration=12", "trajectory.height=5", *QUICK[1:]]
    assert not alerts("healthy_quad", hard)


@pytest.mark.parametrize("landed", [1, 0])  # on the ground; the autopilot does not say
def test_a_motor_test_on_the_ground_gives_no_alarm(landed: int) -> None:
    encoder, monitor = Encoder(default_dialect(), 1), Monitor(MonitorConfig())
    said = []
    for k in range(600):
        t, turning = 0.02 * k, k // 100 % 4
        us = round((5.0 + t) * 1e6)
        frames = [encoder.frame("HIGHRES_IMU", time_usec=us, zacc=-9.81, fields_updated=0x3F)]
        rpm = [3000 if j == turning else 0 for j in range(4)]
        outputs = {f"servo{j + 1}_raw": 1200 if j == turning else 1000 for j in range(4)}
        frames.append(
            encoder.frame("ESC_STATUS", time_usec=us, rpm=rpm, voltage=[16.0] * 4, current=[1.0] * 4, index=0)
        )
        frames.append(encoder.frame("SERVO_OUTPUT_RAW", time_usec=us & 0xFFFFFFFF, **outputs))
        if k % 50 == 0:
            frames.append(encoder.frame("HEARTBEAT", type=2, autopilot=12, base_mode=128, mavlink_version=3))
            frames.append(encoder.frame("EXTENDED_SYS_STATE", landed_state=landed))
        for frame in frames:
            said += monitor.feed(frame, us)
    assert monitor.vehicles()[0].airframe is not None
    assert not [event for event in said if isinstance(event, AlertEvent)]
    assert math.isfinite(monitor.vehicles()[0].last_t)
