"""Style names → colours, theme by theme. Colour follows severity alone; every sign is told by shape and word too."""

from functools import cache

from rich.style import Style

_DARK = {
    "": "#c8ccd0 on #101418",
    "dim": "#7f8890 on #101418",
    "bold": "bold #ffffff on #101418",
    "title": "#5d7f9c on #101418",
    "ok": "#d7e0d7 on #101418",
    "warn": "bold #ffb454 on #101418",
    "fail": "bold #ff6b60 on #101418",
    "curve": "bold #ff6b60 on #101418",
    "alarm": "bold #ffffff on #c81e1e",
    "caution": "bold #000000 on #ffb454",
    "acked": "#ff9a90 on #3a1818",
    "stale": "bold #000000 on #b8bec4",
    "unknown": "italic #9aa4ad on #101418",
    "key": "bold #7fc4ff on #101418",
    "pick": "bold #7fc4ff on #101418",
}
_LIGHT = {
    "": "#20262c on #fbfbf8",
    "dim": "#646c74 on #fbfbf8",
    "bold": "bold #000000 on #fbfbf8",
    "title": "#3d6a94 on #fbfbf8",
    "ok": "#1d3a1d on #fbfbf8",
    "warn": "bold #8a4b00 on #fbfbf8",
    "fail": "bold #b00014 on #fbfbf8",
    "curve": "bold #b00014 on #fbfbf8",
    "alarm": "bold #ffffff on #b00014",
    "caution": "bold #000000 on #ffb000",
    "acked": "#8c1020 on #f6dada",
    "stale": "bold #ffffff on #4a5056",
    "unknown": "italic #5a626a on #fbfbf8",
    "key": "bold #0050a0 on #fbfbf8",
    "pick": "bold #0050a0 on #fbfbf8",
}
_CONTRAST = {
    **dict.fromkeys(("", "dim", "ok"), "#ffffff on #000000"),
    **dict.fromkeys(("bold", "title"), "bold #ffffff on #000000"),
    "warn": "bold #ffff00 on #000000",
    "fail": "bold reverse #ffffff on #000000",
    "curve": "bold #ffff00 on #000000",
    "alarm": "bold #000000 on #ffffff",
    "caution": "bold #000000 on #ffff00",
    "acked": "underline #ffffff on #000000",
    "stale": "bold #000000 on #ffff00",
    "unknown": "italic #ffff00 on #000000",
    "key": "bold #00ffff on #000000",
    "pick": "bold #00ffff on #000000",
}
# Okabe and Ito's palette: told apart with any of the usual colour blindnesses
_COLOUR_BLIND = {
    **_DARK,
    "warn": "bold #f0e442 on #101418",
    "fail": "bold #e69f00 on #101418",
    "curve": "bold #e69f00 on #101418",
    "alarm": "bold #000000 on #e69f00",
    "caution": "bold #000000 on #f0e442",
    "acked": "#e69f00 on #2c2410",
    "stale": "bold #000000 on #56b4e9",
    "key": "bold #56b4e9 on #101418",
    "pick": "bold #56b4e9 on #101418",
}
_NO_COLOUR = {
    **dict.fromkeys(("", "ok"), ""),
    **dict.fromkeys(("dim", "unknown"), "dim"),
    **dict.fromkeys(("bold", "title", "key", "pick", "warn", "curve"), "bold"),
    "fail": "bold reverse",
    "alarm": "bold reverse",
    "caution": "bold reverse",
    "stale": "reverse",
    "acked": "bold underline",
}
PALETTES = {
    "dark": _DARK,
    "light": _LIGHT,
    "high contrast": _CONTRAST,
    "colour-blind": _COLOUR_BLIND,
    "no colour": _NO_COLOUR,
}


@cache
def style_of(theme: str, name: str) -> Style:
    """Return the style of this name in a theme."""
    return Style.parse(PALETTES[theme][name] or "none")
