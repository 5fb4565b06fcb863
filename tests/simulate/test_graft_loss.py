"""The loss that is put into a recording, against a wrench worked out by hand and against the simulator."""

import math

import numpy as np
import pytest

from gcs_health.airframe import Airframe, AirframeSource, Rotor
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.samples import EscStatus, Imu
from gcs_health.simulate.flight import Flight
from gcs_health.simulate.graft_fault import parse_fault
from gcs_health.simulate.graft_loss import Loss, loss_of
from gcs_health.simulate.recording import Flown, with_times
from gcs_health.simulate.scenario import load_scenario

ARMS = ((0.1, 0.1, 1), (-0.1, -0.1, 1), (0.1, -0.1, -1), (-0.1, 0.1, -1))
HOVER = 500.0  # rad/s
THRUST = 9.80665 / 4.0 / HOVER**2
ROLL, PITCH, YAW = 1.0e-4, 0.8e-4, 0.1e-4


def still(places: tuple[tuple[float, float, int], ...] = ARMS, yaw: float = YAW, land: float = 1e9) -> Flown:
    """A flight at constant hover speed whose rotors idle from `land` on."""
    rotors = tuple(Rotor(k + 1, k, (x, y, 0.0), s) for k, (x, y, s) in enumerate(places))  # type: ignore[arg-type]
    reach = max(abs(place[0]) for place in places), max(abs(place[1]) for place in places)
    matrix = np.array(
        [
            [-ROLL * y / reach[1] for _, y, _ in places],
            [PITCH * x / reach[0] for x, _, _ in places],
            [yaw * s for *_, s in places],
            [-THRUST * 4.0 / len(places)] * len(places),
        ]
    )
    t = np.arange(100.0, 112.0, 0.01)
    speed = np.where(t[:, None] < land, HOVER, 120.0) * np.ones(len(places))
    airframe = Airframe("by hand", rotors, AirframeSource.FILE)
    return Flown((1, 1), airframe, matrix, t, speed, t, 100.0, 112.0, {}, frozenset(), frozenset(), (), {})


def missing(flown: Flown, loss: Loss, rotor: int) -> np.ndarray:
    """G diag(k) (u + du) - G u, row by row: what the vehicle must show."""
    k = np.ones((flown.speed.shape[1], len(loss.t)))
    k[rotor] -= loss.share
    squares = np.full_like(k, HOVER**2)
    return flown.matrix @ (k * (squares + loss.change) - squares)


def test_the_first_moment_is_the_missing_wrench() -> None:
    """theta h_i by hand: motor 3 (front left) at .6 drops p by .4 x 1e-4 x 500², q by .4 x .8e-4 x 500²..."""
    loss = loss_of(still(), 2, parse_fault("rotor=3 effectiveness=0.6 at=2"))
    assert loss.t[0] == pytest.approx(102.0)
    slopes = (loss.rates[:, 2] - loss.rates[:, 1]) / 0.001
    np.testing.assert_allclose(slopes, [-10.0, -8.0, 1.0], rtol=0.06)
    assert loss.lift[0] == pytest.approx(0.4 * 9.80665 / 4.0)
    assert np.abs(loss.change[:, 0]).max() == 0.0


@pytest.mark.parametrize("fault", ["at=2", "at=2 ramp=0.5", "at=2 until=4", "at=2 loop=0.3"])
def test_what_is_seen_is_what_the_rotors_do_not_give(fault: str) -> None:
    """At every moment: measured acceleration = G k (u + du) - G u. The estimator's own model, no more."""
    flown = still()
    loss = loss_of(flown, 2, parse_fault(f"rotor=3 effectiveness=0.5 {fault}"))
    wrench = missing(flown, loss, 2)
    seen = np.diff(loss.rates, axis=1) / 0.001
    jumps = np.abs(np.diff(loss.share)) > 0.1
    far = ~jumps
    np.testing.assert_allclose(seen[:, far], wrench[:3, :-1][:, far], atol=0.02)
    np.testing.assert_allclose(loss.lift, wrench[3], atol=1e-6)


@pytest.mark.parametrize(
    "places",
    [
        ARMS,
        tuple(
            (math.cos(math.radians(a)), math.sin(math.radians(a)), 1 - 2 * (k % 2))
            for k, a in enumerate(range(30, 390, 60))
        ),
    ],
)
def test_in_the_end_the_wrench_is_whole_and_the_speeds_are_the_least(
    places: tuple[tuple[float, float, int], ...],
) -> None:
    flown = still(places)
    loss = loss_of(flown, 2, parse_fault("rotor=3 effectiveness=0.7 at=2"))
    left = missing(flown, loss, 2)[:, -1]
    np.testing.assert_allclose(left / np.abs(flown.matrix[:, 2] * HOVER**2), 0.0, atol=1e-3)
    assert np.abs(loss.rates[:, -1]).max() < 0.01
    # of all changes that ask this wrench of the mixer, the one of least norm: in its row space
    asked = loss.change[:, -1]
    np.testing.assert_allclose(np.linalg.pinv(flown.matrix) @ flown.matrix @ asked, asked, atol=1.0)
    if len(places) == 4:
        np.testing.assert_allclose(asked / HOVER**2, [0.0, 0.0, 0.3 / 0.7, 0.0], atol=1e-3)


def test_no_rotor_speed_jumps_even_where_no_yaw_gain_is_known() -> None:
    for flown in (still(), still(yaw=0.0)):
        loss = loss_of(flown, 2, parse_fault("rotor=3 effectiveness=0.5 at=2 until=5"))
        assert np.abs(np.diff(loss.change, axis=1)).max() < 0.02 * HOVER**2


def test_it_ends_with_until_and_on_the_ground() -> None:
    loss = loss_of(still(), 2, parse_fault("rotor=3 effectiveness=0.5 at=2 until=4"))
    assert np.abs(loss.change[:, -1]).max() < 1e-3 * HOVER**2
    assert loss.share[-1] == 0.0
    landed = loss_of(still(land=106.0), 2, parse_fault("rotor=3 effectiveness=0.5 at=2"))
    ground = landed.t > 106.2
    assert np.abs(landed.rates[:, ground]).max() < 0.02
    assert np.abs(landed.rates).max() > 0.5


def test_the_transient_is_near_that_of_the_simulators_controller() -> None:
    """The same flight flown healthy and with the loss: rates, a_z and speeds of both against the graft's."""
    changes = ["vehicle=bebop2", "trajectory.height=3", "trajectory.duration=18", "trajectory.lands=false"]
    changes += ["trajectory.kind=hover", "wind.speed=0", "wind.turbulence=none"]
    changes += ["telemetry.rates.HIGHRES_IMU=250", "telemetry.rates.ESC_STATUS=100"]

    def fly(faults: str) -> tuple[np.ndarray, np.ndarray]:
        imu, escs = [], []
        for r in with_times(
            list(Flight(load_scenario("healthy_quad", [*changes, f"fault={faults}"])).run()), DIALECT
        ):
            if isinstance(r.sample, Imu):
                imu.append((r.t, r.sample.p, r.sample.q, r.sample.r, r.sample.az))
            elif isinstance(r.sample, EscStatus):
                escs.append((r.t, *r.sample.speed))
        return np.array(imu).T, np.array(escs).T

    (it, *healthy), (et, *speeds) = fly("[]")
    (_, *faulty), (_, *changed) = fly("[{kind='effectiveness', motor=3, at=15.0, size=0.7}]")
    airframe = load_scenario("healthy_quad", changes).vehicle.airframe()
    g = airframe.effectiveness
    reach = [max(abs(r.position[axis]) for r in airframe.rotors) for axis in (0, 1)]
    matrix = np.array(
        [
            [-(g.roll or 0.0) * r.position[1] / reach[1] for r in airframe.rotors],
            [(g.pitch or 0.0) * r.position[0] / reach[0] for r in airframe.rotors],
            [(g.yaw or 0.0) * r.spin for r in airframe.rotors],
            [-(g.thrust or 0.0)] * 4,
        ]
    )
    flown = Flown(
        (1, 1),
        airframe,
        matrix,
        et,
        np.array(speeds).T,
        et,
        it[0],
        it[-1],
        {},
        frozenset(),
        frozenset(),
        (),
        {},
    )
    loss = loss_of(flown, 2, parse_fault(f"rotor=3 effectiveness=0.7 at={20.0 - it[0]}"))
    when = np.arange(20.0, 20.5, 0.004)
    rates = [np.interp(when, it, b - a) for a, b in zip(healthy, faulty, strict=True)]
    ours = [np.interp(when, loss.t, row) for row in (*loss.rates, loss.lift)]
    for simulated, grafted in zip(rates[:2], ours[:2], strict=True):
        assert np.abs(grafted).max() == pytest.approx(np.abs(simulated).max(), rel=0.4)
        assert np.sign(grafted[20]) == np.sign(simulated[20])
    assert np.sqrt(np.mean((ours[3] - rates[3]) ** 2)) < 0.25 * np.abs(rates[3]).max()
    u = float(np.interp(20.0, et, speeds[2])) ** 2
    for rotor in range(4):
        simulated = np.interp(when, et, changed[rotor] ** 2 - speeds[rotor] ** 2) / u
        grafted = np.interp(when, loss.t, loss.change[rotor]) / u
        assert np.abs(grafted - simulated).max() < 0.09


DIALECT = default_dialect()
