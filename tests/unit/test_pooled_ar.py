"""The pooled AR estimator on signals of a known law: one resonance that moves with k, another one a rotor."""

import math
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from synthetic_flight import airframe

from gcs_health.errors import AirframeError, ConfigError
from gcs_health.estimators.contract import Estimate, Reason, Status
from gcs_health.estimators.labelled_flights import IMU, LabelledFlight, labelled
from gcs_health.estimators.pooled_ar import PooledArConfig, PooledArEstimator
from gcs_health.estimators.pooled_ar_answers import probability, rarity
from gcs_health.estimators.pooled_ar_file import load, save
from gcs_health.estimators.pooled_ar_model import PooledModel, minimise, spread
from gcs_health.estimators.pooled_ar_training import TrainingSettings, samples, train, windows
from gcs_health.samples import BoomReading, ImuFilterReading, ImuReading, Reading

RATE = 200.0
GRAVITY = 9.81
STEPS, BETWEEN = (0.2, 0.4, 0.6, 0.8, 1.0), (0.1, 0.3, 0.5, 0.7, 0.9)


def vibration(rotor: int, k: float, seconds: float, seed: int, loud: float = 1.0) -> np.ndarray:
    """Return az: rotor 0 bends the first coefficient downward with k, rotor 1 the second."""
    noise = loud * np.random.default_rng(seed).standard_normal(round(seconds * RATE) + 200)
    a1, a2 = (1.2 - 0.8 * k, -0.8) if rotor == 0 else (1.2 - 0.2 * k, -0.8 + 0.7 * k)
    return lfilter([1.0], [1.0, -a1, -a2], noise)[200:] - GRAVITY


def flight(rotor: int, k: float, seconds: float, seed: int, loud: float = 1.0) -> LabelledFlight:
    booms = np.stack([vibration(0, k if rotor == 0 else 0.0, seconds, seed, loud),
                      vibration(1, k if rotor == 1 else 0.0, seconds, seed + 1, loud)], axis=1)  # fmt: skip
    return LabelledFlight(f"v{seed % 5}", rotor, k, {"az": vibration(rotor, k, seconds, seed, loud)}, booms)


def learned(channel: str = "az", loud: float = 1.0, **changes: object) -> PooledModel:
    rows = [(0, 0.0), *[(rotor, k) for rotor in (0, 1) for k in STEPS]]
    fitted = [flight(rotor, k, 30.0, 10 + i, loud) for i, (rotor, k) in enumerate(rows)]
    held_out = [
        flight(rotor, k, 20.0, 100 + 10 * rotor + i, loud) for rotor in (0, 1) for i, k in enumerate(BETWEEN)
    ]
    healthy = [flight(0, 0.0, 60.0, 200 + i, loud) for i in range(5)]
    settings = TrainingSettings(
        "test", "calm", RATE, (channel,), orders=(2, 4), basis=(2, 3), value_window=4.0
    )
    return train(fitted, held_out, healthy, replace(settings, **changes))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def model() -> PooledModel:
    return learned()


def readings(az: np.ndarray, start: float = 0.0, rate: float = RATE) -> list[ImuReading]:
    return [
        ImuReading(start + k / rate, 0.0, 0.0, value, 0.0, 0.0, 0.0) for k, value in enumerate(az.tolist())
    ]


def play(model: PooledModel | tuple[PooledModel, ...], stream: list[Reading], rotors: int = 6,
         mode: str = "recommended") -> PooledArEstimator:  # fmt: skip
    models = model if isinstance(model, tuple) else (model,)
    estimator = PooledArEstimator(airframe(rotors), PooledArConfig(mode=mode, models=models))  # type: ignore[arg-type]
    for reading in stream:
        estimator.feed(reading)
    return estimator


def told(model: PooledModel, stream: list[ImuReading], rotor: int = 0, **more: object) -> Estimate:
    return play(model, list(stream), **more).estimates(stream[-1].t)[rotor]  # type: ignore[arg-type]


def test_training_learns_the_law(model: PooledModel) -> None:
    facts = dict(model.facts)
    assert [len(part.theta) for part in model.parts] == [2, 2]
    assert facts["mean_error"] < 0.05
    assert model.names > 0.9
    assert 0.0 <= model.bias < 0.05
    assert 0.05 < model.threshold < 0.5
    assert model.healthy_time == pytest.approx(250.0)  # the last window of each flight is cut short
    for part in model.parts:
        np.testing.assert_allclose(part.variance, 1.0, atol=0.1)


@pytest.mark.parametrize("rotor", [0, 1])
@pytest.mark.parametrize("k", [0.0, 0.35, 0.8])
def test_the_value_is_true_within_its_interval(model: PooledModel, rotor: int, k: float) -> None:
    estimate = told(model, readings(vibration(rotor, k, 8.0, 900)), rotor)
    assert estimate.status is Status.VALID
    assert abs(estimate.value - k) <= 2.5 * estimate.std
    assert estimate.std < 0.12


def test_on_line_is_off_line(model: PooledModel) -> None:
    """Blocks of the stream give what the training's windows give."""
    az = vibration(0, 0.6, 8.0, 901)
    blocks = windows(model, LabelledFlight("x", 0, 0.6, {"az": az}), 0, 4.0, every=1)
    k = minimise(blocks.sum(axis=1))
    expected = spread(blocks, k, samples(model, blocks))
    estimator = play(model, readings(az))
    verdict = estimator._watches[0].verdict
    assert verdict is not None
    assert verdict.views[0].k == pytest.approx(k[-1], abs=1e-9)
    assert verdict.views[0].std == pytest.approx(math.hypot(math.sqrt(expected.robust[-1]), model.bias))


def test_stated_intervals_cover(model: PooledModel) -> None:
    inside = []
    for seed in range(8):
        for k in (0.15, 0.5, 0.85):
            blocks = windows(model, flight(0, k, 20.0, 3000 + seed), 0, 4.0)
            found = minimise(blocks.sum(axis=1))
            std = np.sqrt(spread(blocks, found, samples(model, blocks)).robust + model.bias**2)
            inside += list(np.abs(found - k) <= 1.96 * std)
    assert 0.9 <= np.mean(inside) <= 1.0


def test_a_fault_is_suspected_and_a_healthy_flight_is_not(model: PooledModel) -> None:
    healthy, faulty = vibration(0, 0.0, 20.0, 902), vibration(0, 0.7, 6.0, 903)
    stream = readings(np.concatenate([healthy, faulty]))
    estimator = PooledArEstimator(airframe(6), PooledArConfig(models=(model,)))
    said = [estimate for reading in stream for estimate in estimator.feed(reading)]
    assert not [one for one in said if one.t < 20.0]
    suspected = [one for one in said if one.failure_probability > 0.44]
    assert suspected[0].t < 21.5
    assert {one.rotor for one in suspected} == {0, 3}  # it and its opposite: neither is named
    assert max(one.failure_probability for one in said) <= 0.5
    last = estimator.estimates(stream[-1].t)
    assert dict(last[0].evidence)["candidates"] == "1 or 4"
    assert dict(last[0].evidence)["probability_anywhere"] > 0.99
    assert Reason.OPPOSITE_ALIKE in last[0].reasons
    assert last[1].failure_probability < 0.01


def test_a_rotor_without_an_opposite_is_named(model: PooledModel) -> None:
    estimate = told(model, readings(vibration(1, 0.7, 8.0, 904)), 1, rotors=5)
    assert estimate.failure_probability > 0.9
    assert estimate.reasons == ()


def test_what_would_be_seen_is_above_the_threshold(model: PooledModel) -> None:
    estimate = told(model, readings(vibration(0, 0.0, 8.0, 905)))
    assert model.threshold < estimate.detectable < 1.0
    assert estimate.failure_probability < 0.05


@pytest.mark.parametrize(
    ("stream", "reason"),
    [
        (readings(vibration(0, 0.3, 8.0, 906), rate=100.0), Reason.MODEL_RATE),
        (readings(vibration(0, 0.3, 8.0, 906), rate=230.0), Reason.MODEL_RATE),
        (readings(vibration(0, 0.3, 8.0, 906, loud=2.0)), Reason.UNMODELLED),
        (readings(vibration(0, 0.3, 8.0, 906, loud=0.5)), Reason.UNMODELLED),
        (readings(np.random.default_rng(1).standard_normal(1600) - GRAVITY), Reason.UNMODELLED),
        (readings(vibration(0, 0.3, 1.6, 906)), Reason.FILLING),
        (
            [ImuFilterReading(0.0, 0.005, math.nan, "test"), *readings(vibration(0, 0.3, 8.0, 906))],
            Reason.MODEL_FILTER,
        ),
    ],
    ids=[
        "half the rate",
        "another rate",
        "louder air",
        "calmer air",
        "another law",
        "too short",
        "another filter",
    ],
)
def test_it_refuses_with_the_reason(model: PooledModel, stream: list[ImuReading], reason: Reason) -> None:
    estimate = told(model, stream)
    assert estimate.status is not Status.VALID
    assert reason in estimate.reasons


def test_an_uneven_window_has_no_value(model: PooledModel) -> None:
    az = vibration(0, 0.3, 8.0, 907) + GRAVITY
    az[1120:1280] *= 2.5
    assert Reason.UNSTEADY in told(model, readings(az - GRAVITY)).reasons


def test_gaps_restart_and_jitter_does_not(model: PooledModel) -> None:
    az = vibration(0, 0.5, 12.0, 908)
    rng = np.random.default_rng(1)
    jitter = [reading._replace(t=reading.t + 0.001 * rng.uniform(-1.0, 1.0)) for reading in readings(az)]
    assert told(model, jitter).status is Status.VALID
    stream = readings(az[:1200]) + readings(az[1201:], start=1201 / RATE + 0.5)
    gapped = told(model, stream)
    assert gapped.status is Status.VALID
    assert abs(gapped.value - 0.5) < 0.12
    silent = play(model, list(stream)).estimates(stream[-1].t + 2.0)[0]
    assert Reason.IMU_STALE in silent.reasons
    assert silent.status is not Status.VALID


def test_of_several_models_that_of_the_air_answers(model: PooledModel) -> None:
    severe = learned(loud=3.0, regime="severe")
    for loud in (1.0, 3.0):
        stream = readings(vibration(0, 0.6, 8.0, 909, loud))
        estimate = play((model, severe), list(stream)).estimates(stream[-1].t)[0]
        assert estimate.status is Status.VALID
        assert abs(estimate.value - 0.6) < 0.12


def test_booms_are_each_rotors_own() -> None:
    model = learned("boom")
    made = flight(1, 0.6, 8.0, 910)
    absent = (math.nan,) * 4
    stream: list[Reading] = [
        BoomReading(k / RATE, (*row, *absent))
        for k, row in enumerate(made.booms.tolist())  # type: ignore[union-attr]
    ]
    estimates = play(model, stream).estimates(8.0)
    assert abs(estimates[1].value - 0.6) < 0.12
    assert estimates[0].value < 0.12
    assert estimates[0].failure_probability < 0.01


def test_the_state_goes_on_with_its_model(model: PooledModel) -> None:
    stream = readings(vibration(0, 0.4, 8.0, 911))
    first = play(model, list(stream[:700]))
    second = pickle.loads(pickle.dumps(first))
    for reading in stream[700:]:
        assert repr(first.feed(reading)) == repr(second.feed(reading))
    assert repr(first.estimates(8.0)) == repr(second.estimates(8.0))


def test_a_saved_model_is_the_same(model: PooledModel, tmp_path: Path) -> None:
    save(model, tmp_path / "model.npz")
    again = load(tmp_path / "model.npz")
    stream = readings(vibration(1, 0.4, 8.0, 912))
    assert repr(told(model, stream)) == repr(told(again, stream))
    assert again.facts == model.facts
    (tmp_path / "no.npz").write_bytes(b"PK no")
    with pytest.raises(ConfigError, match=r"no\.npz"):
        load(tmp_path / "no.npz")
    with pytest.raises(ConfigError, match=r"absent\.npz"):
        load(tmp_path / "absent.npz")


def test_the_papers_mode_tests_whiteness_and_t(model: PooledModel) -> None:
    paper = replace(model, bias=0.0)
    healthy = play(paper, list(readings(vibration(0, 0.0, 8.0, 913))), mode="paper").estimates(8.0)
    assert healthy[0].failure_probability < 0.9
    estimates = play(paper, list(readings(vibration(0, 0.8, 8.0, 914))), mode="paper").estimates(8.0)
    assert estimates[0].status is Status.VALID
    assert abs(estimates[0].value - 0.8) < 4.0 * estimates[0].std
    assert estimates[0].failure_probability > 0.9  # white, and t beyond its critical point
    assert estimates[1].failure_probability < 0.05
    assert Reason.NO_MODEL in estimates[2].reasons


def test_probabilities_are_nine_tenths_at_the_threshold(model: PooledModel) -> None:
    at = rarity(model, model.threshold)
    assert probability(0.0) == pytest.approx(0.9)
    assert probability(rarity(model, 0.0) - at) < 0.02
    steps = [rarity(model, k) for k in np.linspace(-0.4, 3.0, 60)]
    assert steps == sorted(steps)
    # one alarm per five minutes of 10 s maxima, or rarer where the count says so
    assert math.exp(-at) <= 10.0 / 300.0 + 1e-9


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"fitted": 0.0}, "healthy"),
        ({"healthy": 0.5}, "threshold"),
        ({"cutoff": 20.0}, "20 Hz"),
        ({"channels": ("boom", "az")}, "two models"),
    ],
)
def test_training_says_what_is_missing(change: dict[str, object], match: str) -> None:
    fitted = [flight(0, k, 2.0, 1) for k in (0.0, *STEPS) if k != change.get("fitted")]
    healthy = [flight(0, float(change.get("healthy", 0.0)), 2.0, 2)]  # type: ignore[arg-type]
    settings = TrainingSettings("test", "calm", RATE, ("az",))
    settings = replace(
        settings, **{name: value for name, value in change.items() if name in ("cutoff", "channels")}
    )
    with pytest.raises(ConfigError, match=match):
        train(fitted, [flight(0, 0.3, 2.0, 3)], healthy, settings)


def test_models_must_fit_the_airframe_and_the_mode(model: PooledModel) -> None:
    far = replace(model, parts=tuple(replace(part, rotor=part.rotor + 5) for part in model.parts))
    with pytest.raises(AirframeError, match="rotor 7"):
        PooledArEstimator(airframe(6), PooledArConfig(models=(far,)))
    two = replace(model, channels=("az", "p"))
    with pytest.raises(ConfigError, match="mode"):
        PooledArEstimator(airframe(6), PooledArConfig(mode="paper", models=(two,)))


def test_flights_are_cut_at_gaps() -> None:
    stream = readings(vibration(0, 0.0, 3.0, 1)) + readings(vibration(0, 0.0, 2.0, 2), start=4.0)
    cut = labelled(stream, "v", 0, 0.0, RATE, 0.5, 5.5)
    assert [one.length for one in cut] == [500, 301]
    assert set(cut[0].signals) == set(IMU)
