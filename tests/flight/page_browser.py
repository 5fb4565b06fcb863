"""A real headless browser that opens a page at a width and says what it measured there."""

import html
import json
import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on the path")

# a window narrower than 500 px does not exist in headless chromium: frames of any width do
_FRAMES = """<!doctype html><meta charset="utf-8">{frames}<pre id="said"></pre><script>
const said = {{}}, frames = [...document.querySelectorAll("iframe")];
for (const f of frames) f.onload = () => setTimeout(() => {{
  const d = f.contentDocument, plots = [...d.querySelectorAll(".js-plotly-plot")];
  said[f.clientWidth] = {{
    width: d.documentElement.scrollWidth,
    plots: plots.length,
    drawn: plots.filter(p => p.querySelector("svg.main-svg")).length,
    widest: Math.max(0, ...plots.map(p => p.getBoundingClientRect().right)),
    requests: f.contentWindow.performance.getEntriesByType("resource").map(r => r.name),
  }};
  document.getElementById("said").textContent = JSON.stringify(said);
}}, 500);
</script>"""
_FRAME = '<iframe style="width:{width}px;height:900px;border:0" srcdoc="{page}"></iframe>'


def command(*more: str) -> list[str]:
    """A headless chromium."""
    assert CHROMIUM is not None
    root = ["--no-sandbox"] if os.geteuid() == 0 else []
    return [
        CHROMIUM,
        "--headless",
        "--disable-gpu",
        "--hide-scrollbars",
        "--virtual-time-budget=10000",
        *root,
        *more,
    ]


def measured(page: Path, widths: Sequence[int], place: Path) -> dict[int, dict[str, Any]]:
    """What a browser says of a page at each width [px]."""
    text = html.escape(page.read_text(encoding="utf-8"))
    frames = "".join(_FRAME.format(width=width, page=text) for width in widths)
    file = place / "frames.html"
    file.write_text(_FRAMES.format(frames=frames), encoding="utf-8")
    done = subprocess.run(
        command("--window-size=1400,900", "--dump-dom", file.as_uri()),
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    found = re.search(r'<pre id="said">(.*?)</pre>', done.stdout, re.DOTALL)
    assert found is not None
    return {int(width): said for width, said in json.loads(html.unescape(found[1])).items()}
