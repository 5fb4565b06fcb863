"""The widgets alone: exact cells."""

import math
from dataclasses import replace

import pictures as p
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_health.dashboard.snapshot import EMPTY, Level
from gcs_health.dashboard.state import Overlay, Page, State
from gcs_health.dashboard.view.airframe import airframe_map, zones
from gcs_health.dashboard.view.alerts import alert_list
from gcs_health.dashboard.view.lines import beside, cut, fit, line, plain, sides, width, wrap
from gcs_health.dashboard.view.link import blind_map
from gcs_health.dashboard.view.plot import plot, sparkline
from gcs_health.dashboard.view.rotor_page import rotor_page
from gcs_health.dashboard.view.rotors import columns, table
from gcs_health.dashboard.view.screen import render
from gcs_health.dashboard.view.timeline import time_at, timeline
from gcs_health.dashboard.view.top import banner, head, strip


def texts(lines):  # type: ignore[no-untyped-def]
    return [plain(each).rstrip() for each in lines]


def test_fit_cut_and_sides_keep_styles_and_widths() -> None:
    said = line(("abc", "fail"), "defg")
    assert fit(said, 5) == (("abc", "fail"), ("d", ""), ("…", ""))
    assert fit(said, 9) == (("abc", "fail"), ("defg", ""), ("  ", ""))
    assert cut(said, 2, 5) == (("c", "fail"), ("de", ""))
    assert plain(sides(said, line("xy"), 12)) == "abcdefg   xy"
    assert plain(sides(said, line("xyz"), 8)) == "abc… xyz"
    assert plain(sides(said, line("xyz"), 4)) == "abc…"
    assert texts(beside([line("a")], 3, [line("b"), line("c")], 1)) == ["a   b", "    c"]
    assert texts(wrap("one two three", 8, "", 2)) == ["one two", "  three"]


def test_a_healthy_quad_from_above() -> None:
    assert texts(airframe_map(p.vehicle("quad").rotors, 24, 11)) == [
        "╭─────────╮  ╭─────────╮",
        "│    3    │  │    1    │",
        "│    ↻    │  │    ↺    │",
        "╰─────────╯  ╰─────────╯",
        "          ·   ·",
        "            ▲",
        "          ·   ·",
        "╭─────────╮  ╭─────────╮",
        "│    2    │  │    4    │",
        "│    ↺    │  │    ↻    │",
        "╰─────────╯  ╰─────────╯",
    ]


def test_each_level_has_a_border_and_a_sign_of_its_own() -> None:
    levels = {1: Level.FAILED, 2: Level.WARN, 3: Level.UNKNOWN}
    assert texts(airframe_map(p.vehicle("quad", levels).rotors, 24, 11))[:4] == [
        "┌╌╌╌╌╌╌╌╌╌┐  ╔═════════╗",
        "╎    3    ╎  ║    1    ║",
        "╎    ?    ╎  ║    ✗    ║",
        "└╌╌╌╌╌╌╌╌╌┘  ╚═════════╝",
    ]
    assert "┃    !    ┃" in texts(airframe_map(p.vehicle("quad", levels).rotors, 24, 11))[9]


def test_stacked_rotors_share_a_box_the_upper_one_first() -> None:
    drawn = texts(airframe_map(p.vehicle("coax", {6: Level.FAILED}).rotors, 24, 11))
    assert drawn[:4] == [
        "╭─────────╮  ╭─────────╮",
        "│    3↻   │  │    1↺   │",
        "│    4↺   │  │    2↻   │",
        "╰─────────╯  ╰─────────╯",
    ]
    assert drawn[-4:] == [
        "╔═════════╗  ╭─────────╮",
        "║    5↺   ║  │    7↻   │",
        "║    6✗   ║  │    8↺   │",
        "╚═════════╝  ╰─────────╯",
    ]


@pytest.mark.parametrize("frame", ["quad", "hexa", "octa"])
def test_boxes_lie_where_the_geometry_says(frame: str) -> None:
    rotors = p.vehicle(frame).rotors
    cells, rows = 60, 29
    for x0, y0, x1, y1, motor in zones(rotors, cells, rows):
        forward, right, _ = rotors[motor - 1].position
        across, up = (x0 + x1) / 2 - cells / 2, rows / 2 - (y0 + y1) / 2
        assert math.atan2(across / 2, up) == pytest.approx(math.atan2(right, forward), abs=0.12)


def test_a_table_row_is_exactly_this() -> None:
    rows = texts(table(p.vehicle("quad", {1: Level.FAILED, 4: Level.UNKNOWN}).rotors, 54, False))
    assert rows == [
        "── rotors ────────────────────────────────────────────",
        "M  verdict             eff unbal   rpm    A",
        "1  ✗ LOST 97 %     .03±.03   1|3 10399  0.6",
        "2    ok            .99±.03   3.3  7343  4.2",
        "3    ok           1.00±.03   1|3  7410  4.3",
        "4  ? unknown             –   3.5     –    –",
        "   why unknown: the last rotor speed is too old",
    ]


def test_wider_tables_add_columns_and_never_reorder_them() -> None:
    before: list[str] = []
    for cells in range(20, 140):
        names = [column.title for column in columns(cells, False)]
        assert set(before) <= set(names)
        assert sum(column.width for column in columns(cells, False)) <= cells
        before = names
    assert before == [
        "M",
        "",
        "verdict",
        "eff",
        "unbal",
        "trend",
        "rpm",
        "A",
        "°C",
        "age s",
        "seen%",
        "drag",
        "degrad.",
        "V",
    ]


def test_sparkline() -> None:
    nan = math.nan
    assert sparkline([0.0, 0.5, 1.0, nan], 4) == "▁▄█·"
    assert (
        sparkline([0.0, 1.0, 0.0, nan], 2) == "█▁"
    )  # the most of each share: a short alarm is never averaged away


def test_plot_draws_a_step_in_braille() -> None:
    drawn = texts(plot([0.0, 1.0, 2.0, 3.0], [([0.0, 0.0, 1.0, 1.0], "")], 11, 2, (0.0, 4.0), (0.0, 1.0)))
    assert drawn == ["   1.0│  ⡏⠁", "   0.0│⣀⣀⡇"]


def test_banner_is_calm_when_well() -> None:
    shown = p.healthy()
    assert (
        plain(banner(shown, shown.vehicles[0], 80)).rstrip()
        == " all 4 rotors ok   a loss of 18 % would be seen now"
    )
    assert {style for _, style in banner(shown, shown.vehicles[0], 80)} <= {"ok", "dim", ""}


def test_banner_names_the_motor_where_it_is_and_since_when() -> None:
    shown = p.failing()
    said = banner(shown, shown.vehicles[0], 80)
    assert plain(said) == (" ✗ PROPELLER LOST ▌ motor 1 front right  97 %  since 04:09.4         enter: why ")
    assert {style for _, style in said} == {"alarm"}


def test_banner_once_acknowledged_stays_but_is_not_loud() -> None:
    shown = p.failing()
    seen = replace(shown, entries=(replace(shown.entries[0], acknowledged=True), *shown.entries[1:]))
    said = banner(seen, seen.vehicles[0], 80)
    assert "PROPELLER LOST" in plain(said)
    assert "seen" in plain(said)
    assert "alarm" not in {style for _, style in said}


def test_a_shelved_alert_leaves_the_verdict_of_the_rotor() -> None:
    shown = p.failing()
    shelved = replace(shown, entries=(replace(shown.entries[0], shelved_until=1e9), *shown.entries[1:]))
    assert "motor 1 LOST: no alert (yet), or shelved" in plain(banner(shelved, shelved.vehicles[0], 80))


def test_banner_of_a_silent_link() -> None:
    shown = p.silent(seconds=7.0)
    assert plain(banner(shown, shown.vehicles[0], 80)).startswith(" ? NOTHING HEARD FOR 7 s")
    alarmed = replace(shown, entries=p.failing().entries)
    assert "PROPELLER LOST" in plain(banner(alarmed, alarmed.vehicles[0], 100))
    assert "link silent 7 s" in plain(banner(alarmed, alarmed.vehicles[0], 100))


def test_banner_says_why_nothing_is_known() -> None:
    shown = p.blind()
    assert (
        plain(banner(shown, shown.vehicles[0], 80)).rstrip()
        == " ? rotors unknown: the last rotor speed is too old"
    )
    one = replace(shown, vehicles=(p.vehicle("quad", {2: Level.UNKNOWN}),))
    assert "3 rotors ok, motor 2 unknown: the last rotor speed is too old" in plain(
        banner(one, one.vehicles[0], 80)
    )


def test_head_says_who_flies() -> None:
    shown = p.healthy()
    assert plain(head(shown, shown.vehicles[0], 80)) == (
        "1.1 PX4 quad X  POSCTL  ARMED  IN AIR 04:11                REC 12 MB  loss 0.8 %"
    )


def test_strip_shows_the_alarms_of_all_vehicles() -> None:
    said = strip(p.two(), "1.1", 80)
    assert plain(said).rstrip() == "▸1.1  ok    2.1  ✗ PROPELLER_LOST motor 4"
    assert "alarm" in {style for _, style in said}


def test_timeline_marks_alerts_armings_and_here() -> None:
    replay = p.replayed().replay
    assert replay is not None
    said = plain(timeline(replay, 80))
    assert said == "‖  0.5x 04:12/05:12      a──────────────────────────────────────────✗●────!────d"
    us = time_at(replay, said.index("●"), 80)
    assert us is not None
    assert abs(us - replay.at_us) < (replay.end_us - replay.start_us) / 50
    assert time_at(replay, 3, 80) is None


def test_blind_map_marks_rotors_and_blind_speeds() -> None:
    craft = p.vehicle("quad")
    heading, marks, bar, scale = texts(blind_map(craft, 64))
    assert "50 Hz" in heading
    assert {"1", "2", "3", "4"} <= set(marks)
    assert {"█", "░"} <= set(bar)
    assert scale.endswith("11001 rpm")
    blind_at = bar.index("░", 10)  # the second fold of 50 Hz: 2 x 314 rad/s or the first
    assert (blind_at + 0.5) / 64 * 1152.0 % 314.16 < 40.0 or (blind_at + 0.5) / 64 * 1152.0 % 314.16 > 274.0


def test_the_list_hides_what_the_filter_does_not_match_and_says_so() -> None:
    lines, keys = alert_list(p.failing(), State(filter="alert motor 1"), 80, 5, p.T)
    assert keys == ["", "1.1-1"]
    assert "3 hidden" in plain(lines[0])
    lines, keys = alert_list(p.failing(), State(filter="nonsense"), 80, 5, p.T)
    assert keys == [""]
    assert "none that match" in plain(lines[1])


def test_the_list_scrolls_to_the_chosen_entry() -> None:
    lines, keys = alert_list(p.failing(), State(entry="note-1"), 80, 3, p.T)
    assert keys == ["", "note-2", "note-1"]
    assert "2 newer above" in plain(lines[0])


SCENES = [p.healthy("octa"), p.failing("hexa"), p.blind("coax"), p.replayed(), p.two(), p.silent(), EMPTY]


@settings(max_examples=30, deadline=None)
@given(
    st.sampled_from(SCENES),
    st.sampled_from(list(Page)),
    st.sampled_from([Overlay.NONE, Overlay.HELP, Overlay.FILTER, Overlay.SEEK]),
    st.integers(1, 220),
    st.integers(1, 70),
)
def test_a_frame_fills_any_screen_exactly(shown, page: Page, over: Overlay, cells: int, rows: int) -> None:  # type: ignore[no-untyped-def]
    frame = render(shown, State(page=page, overlay=over), cells, rows)
    assert len(frame.lines) == rows
    assert {width(each) for each in frame.lines} == {cells}


def test_columns_do_not_jump_with_the_values() -> None:
    one = texts(table(p.vehicle("quad").rotors, 100, False))
    other = texts(table(p.vehicle("quad", {1: Level.FAILED}).rotors, 100, False))
    assert one[3] == other[3]
    assert one[1] == other[1]


def test_the_page_of_a_rotor_has_its_balance_and_the_smallest_fault_of_each_kind() -> None:
    said = texts(rotor_page(p.vehicle("quad"), 2, 100, 40))
    assert "    3.3 g mm (27.5 mg at the tip), G 250 at 4966 rpm" in said
    assert "smallest fault seen now: thrust loss 18 %, unbalance 9 g mm, drag rise none" in said
