"""What each key makes of the state: pure, without a screen."""

from dataclasses import replace

import pictures as p
import pytest

from gcs_health.dashboard import commands as c
from gcs_health.dashboard.snapshot import EMPTY, Snapshot
from gcs_health.dashboard.state import KEYS, THEMES, Overlay, Page, State, press, seek_time


def pressed(shown: Snapshot, *keys: str, state: State | None = None) -> tuple[State, list[c.Command]]:
    state, sent = state or State(), []
    for key in keys:
        state, commands = press(state, key, shown)
        sent += commands
    return state, sent


def test_tab_goes_round_the_pages_and_back() -> None:
    pages = [pressed(p.healthy(), *["tab"] * k)[0].page for k in range(5)]
    assert pages == [Page.OVERVIEW, Page.ALERTS, Page.ROTOR, Page.LINK, Page.OVERVIEW]
    assert pressed(p.healthy(), "shift+tab")[0].page is Page.LINK
    assert pressed(p.healthy(), "l", "o")[0].page is Page.OVERVIEW


def test_enter_opens_why_and_goes_back_where_it_came_from() -> None:
    state, _ = pressed(p.failing(), "tab", "enter")
    assert (state.page, state.entry) == (Page.WHY, "1.1-1")
    assert pressed(p.failing(), "enter", state=state)[0].page is Page.ALERTS
    assert pressed(p.failing(), "escape", state=state)[0].page is Page.ALERTS
    state, _ = pressed(p.healthy(), "enter")
    assert (state.page, state.said) == (Page.OVERVIEW, "no alert to explain")


def test_enter_opens_the_alarm_of_another_vehicle_and_chooses_it() -> None:
    state, _ = pressed(p.two(), "enter")
    assert (state.page, state.vehicle) == (Page.WHY, "2.1")


def test_acknowledge_and_shelve_act_on_the_gravest_alert_if_none_is_chosen() -> None:
    assert pressed(p.failing(), "a")[1] == [c.Acknowledge("1.1-1")]
    assert pressed(p.failing(), "s")[1] == [c.Shelve("1.1-1", 600.0)]
    state, sent = pressed(p.healthy(), "a", "s")
    assert not sent
    assert state.said == "no open alert to shelve"


def test_shelving_again_ends_it() -> None:
    shown = p.failing()
    shelved = replace(
        shown, entries=(replace(shown.entries[0], shelved_until=p.T + 100.0), *shown.entries[1:])
    )
    assert pressed(shelved, "s")[1] == [c.Shelve("1.1-1", 0.0)]


def test_an_acknowledged_alert_is_not_acknowledged_twice() -> None:
    shown = p.failing()
    seen = replace(shown, entries=(replace(shown.entries[0], acknowledged=True),))
    assert pressed(seen, "a")[1] == []


def test_nothing_is_sent_to_a_vehicle_without_a_yes() -> None:
    for key in ("n", "escape", "enter", "q", "r", "space"):
        state, sent = pressed(p.healthy(), "r", key)
        assert (state.overlay, sent, state.quit) == (Overlay.NONE, [], False)
    state, sent = pressed(p.healthy(), "r")
    assert (state.overlay, sent) == (Overlay.REQUEST, [])
    assert pressed(p.healthy(), "r", "y")[1] == [c.RequestRates("1.1")]


def test_nobody_is_asked_where_there_is_nobody_or_nothing_to_ask() -> None:
    assert pressed(p.replayed(), "r")[0].overlay is Overlay.NONE
    assert pressed(EMPTY, "r", "y")[1] == []
    content = replace(p.healthy(), vehicles=(replace(p.vehicle("quad"), requests=""),))
    assert pressed(content, "r")[0].said == "all that can be asked for comes already"


def test_filter_is_typed_kept_and_dropped() -> None:
    state, _ = pressed(p.failing(), "slash", "l", "o", "s", "t", "space", "q", "backspace")
    assert (state.overlay, state.filter) == (Overlay.FILTER, "lost ")
    kept, _ = pressed(p.failing(), "enter", state=state)
    assert (kept.overlay, kept.filter, kept.quit) == (Overlay.NONE, "lost ", False)
    assert pressed(p.failing(), "slash", "escape", state=kept)[0].filter == ""


def test_moving_in_the_list_and_among_rotors() -> None:
    assert pressed(p.failing(), "down", "down")[0].entry == "note-3"
    assert pressed(p.failing(), "down", "down", "down", "down", "down", "down", "up")[0].entry == "note-2"
    assert pressed(p.failing(), "4")[0] == State(page=Page.ROTOR, motor=4)
    assert pressed(p.failing(), "4", "down")[0].motor == 1


def test_vehicles_and_themes_go_round() -> None:
    assert pressed(p.two(), "v")[0].vehicle == "2.1"
    assert pressed(p.two(), "v", "v")[0].vehicle == "1.1"
    assert [pressed(p.two(), *["t"] * k)[0].theme for k in range(6)] == [*THEMES, THEMES[0]]


def test_the_keys_of_a_replay() -> None:
    sent = pressed(
        p.replayed(), "space", "left", "right", "left_square_bracket", "right_square_bracket", "b"
    )[1]
    assert sent == [c.Pause(), c.Step(-1), c.Step(1), c.Speed(-1), c.Speed(1), c.Reverse()]
    replay = p.replayed().replay
    assert replay is not None
    assert pressed(p.replayed(), "home")[1] == [c.Seek(replay.start_us)]
    assert pressed(p.replayed(), "end")[1] == [c.Seek(replay.end_us)]
    assert pressed(p.replayed(), "n")[1] == [c.Seek(p.US + 30_200_000)]
    assert pressed(p.replayed(), "N")[1] == [c.Seek(p.US - 2_400_000)]
    assert pressed(p.replayed(), "m")[1] == [c.Seek(p.US + 58_200_000)]
    assert pressed(p.replayed(), "M")[1] == [c.Seek(replay.start_us + 3_200_000)]
    state, sent = pressed(p.healthy(), "space")
    assert (state.said, sent) == ("only a replay can be moved in time", [])


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("2:30", 150.0), ("1:00:00", 3600.0), ("0:01.5", 1.5), ("50%", 156.0), ("+10", 262.0), ("-5", 247.0)],
)
def test_times_as_people_type_them(text: str, seconds: float) -> None:
    replay = p.replayed().replay
    assert replay is not None
    assert seek_time(text, replay) == replay.start_us + int(seconds * 1e6)
    assert seek_time("soon", replay) is None
    assert seek_time("", replay) is None
    assert seek_time("nan", replay) is None


def test_a_time_is_typed_with_its_signs() -> None:
    replay = p.replayed().replay
    assert replay is not None
    keys = ("g", "2", "colon", "3", "0", "enter")
    assert pressed(p.replayed(), *keys)[1] == [c.Seek(replay.start_us + 150_000_000)]
    assert "not a time" in pressed(p.replayed(), "g", "x", "enter")[0].said
    assert pressed(p.replayed(), "g", "1", "escape")[1] == []


@pytest.mark.parametrize("key", sorted(KEYS))
def test_every_key_is_harmless_with_nobody_there_and_in_every_overlay(key: str) -> None:
    for overlay in Overlay:
        for shown in (EMPTY, p.two(), p.replayed()):
            if overlay is Overlay.REQUEST and shown is EMPTY:
                continue
            state, _ = press(State(overlay=overlay), key, shown)
            assert state.vehicle in ("", "1.1", "2.1")
            assert not state.quit or key == "q"


def test_q_does_not_end_the_watch_over_an_armed_vehicle_by_one_slip() -> None:
    assert not pressed(p.healthy(), "q")[0].quit
    assert not pressed(p.healthy(), "q", "x")[0].quit
    assert pressed(p.healthy(), "q", "y")[0].quit
    assert pressed(p.healthy(), "q", "q")[0].quit
    for shown in (p.replayed(), EMPTY, p.silent(), replace(p.healthy(), ended="over")):
        assert pressed(shown, "q")[0].quit
    parked = replace(p.healthy(), vehicles=(replace(p.vehicle("quad"), armed=False),))
    assert pressed(parked, "q")[0].quit


def test_help_closes_with_any_key_and_ctrl_c_always_ends() -> None:
    assert pressed(p.healthy(), "question_mark")[0].overlay is Overlay.HELP
    assert pressed(p.healthy(), "question_mark", "x")[0].overlay is Overlay.NONE
    for overlay in Overlay:
        assert press(State(overlay=overlay), "ctrl+c", p.healthy())[0].quit
