"""The whole screen as SVG against golden pictures, and what Textual does with keys, clicks, sizes and themes."""

import asyncio
from dataclasses import replace
from typing import Any

import pictures as p
import pytest
from screens import CASES, PAGES, SIZES, Still, golden, on_screen, svg

from gcs_health.dashboard import commands as c
from gcs_health.dashboard.app import NAMED, Dashboard
from gcs_health.dashboard.state import KEYS, THEMES, Overlay, Page
from gcs_health.dashboard.themes import PALETTES, style_of
from gcs_health.dashboard.view.lines import plain


@pytest.mark.parametrize(("scene", "frame", "size"), CASES, ids=lambda value: str(value).replace(", ", "x"))
def test_the_screen_is_as_it_was(scene: str, frame: str, size: tuple[int, int]) -> None:
    wanted = golden(scene, frame, size).read_text(encoding="utf-8")
    same = svg(p.SCENES[scene](frame), size) == wanted  # pytest would print megabytes of difference
    assert same, "changed: python tests/dashboard/screens.py makes it anew; look at the difference"


@pytest.mark.parametrize("page", PAGES)
def test_every_page_is_as_it_was(page: str) -> None:
    wanted = golden(page, "quad", SIZES[0]).read_text(encoding="utf-8")
    same = svg(p.failing(), SIZES[0], keys=(PAGES[page],)) == wanted
    assert same, "changed: python tests/dashboard/screens.py makes it anew; look at the difference"


def shown_lines(app: Dashboard) -> list[str]:
    return [plain(line) for line in app.canvas.frame_shown.lines]


def test_every_key_reaches_the_state_through_textual() -> None:
    seen: dict[str, Any] = {}

    async def act(app: Dashboard, pilot: Any) -> None:
        for key, page in (
            ("tab", Page.ALERTS),
            ("tab", Page.ROTOR),
            ("tab", Page.LINK),
            ("shift+tab", Page.ROTOR),
        ):
            await pilot.press(key)
            assert app.state.page is page
        await pilot.press("escape")
        await pilot.press("question_mark")
        assert app.state.overlay is Overlay.HELP
        assert any("acknowledge" in line for line in shown_lines(app))
        await pilot.press("x", "slash", "m", "o", "t", "o", "r", "enter")
        assert app.state.filter == "motor"
        await pilot.press("slash", "escape", "down", "up", "j", "k", "enter")
        assert app.state.page is Page.WHY
        await pilot.press("escape", "3")
        assert app.state.motor == 3
        await pilot.press(
            "o", "v", "v", "t", "t", "t", "t", "t", "a", "s", "space", "N", "M", "m", "n", "h", "x", "l"
        )
        assert (app.state.page, app.state.theme) == (Page.LINK, "dark")
        await pilot.press("ctrl+c")
        seen["interrupted"] = app.interrupted

    pipeline = on_screen(p.failing(), act)
    assert pipeline.sent == [c.Acknowledge("1.1-1"), c.Shelve("1.1-1", 600.0)]
    assert pipeline.started
    assert seen["interrupted"]


def test_rates_are_requested_only_after_what_will_be_sent_was_shown_and_confirmed() -> None:
    async def act(app: Dashboard, pilot: Any) -> None:
        await pilot.press("r")
        said = " ".join(shown_lines(app))
        assert "ESC_STATUS 10 Hz, its" in said
        assert "parameters." in said
        assert "transmits" in said
        await pilot.press("n", "r", "y")

    assert on_screen(p.healthy(), act).sent == [c.RequestRates("1.1")]


def test_a_replay_is_moved_by_keys_and_by_a_click_on_its_line() -> None:
    async def act(app: Dashboard, pilot: Any) -> None:
        await pilot.press("space", "left", "right", "[", "]", "b", "home", "end", "n", "N", "m", "M")
        await pilot.press("g", "1", ":", "0", "0", "enter")
        await pilot.click(offset=(25, 22))

    sent = on_screen(p.replayed(), act).sent
    replay = p.replayed().replay
    assert replay is not None
    assert sent[:6] == [c.Pause(), c.Step(-1), c.Step(1), c.Speed(-1), c.Speed(1), c.Reverse()]
    assert [type(command) for command in sent[6:]] == [c.Seek] * 8
    assert sent[-2] == c.Seek(replay.start_us + 60_000_000)
    assert isinstance(sent[-1], c.Seek)
    assert sent[-1].us - replay.start_us < 6_000_000


def test_the_mouse_chooses_rotors_alerts_and_hints() -> None:
    async def act(app: Dashboard, pilot: Any) -> None:
        await pilot.click(offset=(18, 4))
        assert (app.state.page, app.state.motor) == (Page.ROTOR, 1)
        await pilot.press("o")
        top = next(y for y, line in enumerate(shown_lines(app)) if "propeller lost, 97" in line)
        await pilot.click(offset=(30, top))
        assert app.state.entry == "1.1-1"
        await pilot.click(offset=(30, top))
        assert app.state.page is Page.WHY
        await pilot.press("escape")
        await pilot.click(offset=(30, 1))
        assert app.state.page is Page.WHY
        hints = shown_lines(app)[-1]
        await pilot.click(offset=(hints.index("?:help"), 23))
        assert app.state.overlay is Overlay.HELP
        await pilot.click(offset=(5, 5))
        assert app.state.overlay is Overlay.NONE

    on_screen(p.failing(), act)


def test_the_command_palette_offers_every_deed() -> None:
    async def act(app: Dashboard, pilot: Any) -> None:
        offered = {command.title: command for command in app.get_system_commands(app.screen)}
        assert {name for _, name, _ in NAMED} | {f"Theme: {theme}" for theme in THEMES} | {"Quit"} == set(
            offered
        )
        await pilot.press("ctrl+p")
        await pilot.press(*"acknow")
        await pilot.pause(0.3)
        await pilot.press("enter")
        await pilot.pause()
        offered["Theme: light"].callback()
        assert app.state.theme == "light"

    assert on_screen(p.failing(), act).sent == [c.Acknowledge("1.1-1")]
    assert all(key in KEYS for key, _, _ in NAMED)


def test_another_size_is_drawn_anew() -> None:
    async def act(app: Dashboard, pilot: Any) -> None:
        for size in ((160, 50), (40, 12), (30, 5), (80, 24)):
            await pilot.resize_terminal(*size)
            await pilot.pause()
            assert {len(line) for line in shown_lines(app)} == {size[0]}
            assert len(shown_lines(app)) == size[1]

    on_screen(p.failing("octa"), act)


def test_only_lines_that_changed_are_drawn() -> None:
    async def act(app: Dashboard, pilot: Any) -> None:
        assert app.draw() == 0
        craft = app.snapshot.vehicles[0]
        faster = replace(craft.rotors[0], speed=900.0)
        app.snapshot = replace(app.snapshot, vehicles=(replace(craft, rotors=(faster, *craft.rotors[1:])),))
        assert app.draw() == 1

    on_screen(p.healthy(), act)


def test_no_colour_where_the_user_wants_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")

    async def act(app: Dashboard, pilot: Any) -> None:
        assert app.state.theme == "no colour"
        styles = {style_of("no colour", style) for line in app.canvas.frame_shown.lines for _, style in line}
        assert all(style.color is None and style.bgcolor is None for style in styles)

    on_screen(p.failing(), act)


@pytest.mark.parametrize("theme", THEMES)
def test_every_theme_has_every_style_and_an_alarm_that_stands_out(theme: str) -> None:
    assert set(PALETTES[theme]) | {"stale"} >= set(PALETTES["dark"])
    assert style_of(theme, "alarm") != style_of(theme, "")
    assert style_of(theme, "fail") != style_of(theme, "")
    assert not style_of(theme, "curve").reverse  # a bar reversed is high where it should be low


def luminance(colour: Any) -> float:
    """Relative luminance after WCAG 2.1."""
    parts = [part / 255.0 for part in colour.get_truecolor()]
    r, g, b = (x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in parts)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


@pytest.mark.parametrize("theme", THEMES[:-1])
@pytest.mark.parametrize(
    "style", ["", "dim", "bold", "ok", "warn", "fail", "alarm", "caution", "stale", "unknown", "key"]
)
def test_text_can_be_read_in_sunlight(theme: str, style: str) -> None:
    """WCAG 2.1 asks for 4.5:1 of text; the alarm for 5 and more."""
    found = style_of(theme, style)
    light, dark = sorted((luminance(found.color), luminance(found.bgcolor)), reverse=True)
    assert (light + 0.05) / (dark + 0.05) >= (5.0 if style == "alarm" else 4.5)


def test_an_error_of_the_pipeline_ends_the_screen() -> None:
    pipeline = Still(p.healthy())

    async def run() -> None:
        app = Dashboard(pipeline)
        async with app.run_test(size=(80, 24)) as pilot:
            pipeline.error, pipeline.done = OSError("gone"), True
            for _ in range(100):
                if not app._exit:
                    await pilot.pause(0.1)
            assert app._exit

    asyncio.run(run())
