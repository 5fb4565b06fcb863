"""A headless browser told what to do over its debugging port (Chrome DevTools Protocol)."""

import asyncio
import base64
import itertools
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import aiohttp

SIZE = (1100, 700)
TOP = {"x": 0, "y": 0, "width": SIZE[0], "height": 40, "scale": 1}  # the first two lines
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--remote-debugging-port=0")
Looks = Callable[[bytes], bool]


async def pictures(browser: str, url: str, profile: Path, key: str, looks: Looks) -> list[bytes]:
    """Open a page of textual-serve; return PNGs: its top and itself once the app draws, and again after the key.

    The key is pressed again each second until the top `looks` as it must.
    """
    command = [
        browser,
        *FLAGS,
        f"--user-data-dir={profile}",
        f"--window-size={SIZE[0]},{SIZE[1]}",
        "about:blank",
    ]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        port = await _port(profile / "DevToolsActivePort")
        async with aiohttp.ClientSession() as http:
            async with http.put(f"http://127.0.0.1:{port}/json/new?about:blank") as answer:
                page = (await answer.json(content_type=None))["webSocketDebuggerUrl"]
            async with http.ws_connect(page, max_msg_size=0) as socket:
                return await _look(Tab(socket), url, key, looks)
    finally:
        process.terminate()
        process.wait(timeout=10)


class Tab:
    """One page."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket, self._numbers = socket, itertools.count(1)

    async def do(self, method: str, **parameters: Any) -> dict[str, Any]:
        number = next(self._numbers)
        await self._socket.send_json({"id": number, "method": method, "params": parameters})
        while True:
            said = await self._socket.receive_json(timeout=20.0)
            if said.get("id") == number:
                assert "error" not in said, said
                return dict(said["result"])

    async def is_true(self, script: str) -> bool:
        said = await self.do("Runtime.evaluate", expression=script, returnByValue=True)
        return bool(said["result"].get("value"))

    async def picture(self, **clip: Any) -> bytes:
        return base64.b64decode((await self.do("Page.captureScreenshot", format="png", **clip))["data"])

    async def press(self, key: str) -> None:
        await self.do("Input.dispatchKeyEvent", type="keyDown", key=key, text=key)
        await self.do("Input.dispatchKeyEvent", type="keyUp", key=key)


async def _look(tab: Tab, url: str, key: str, looks: Looks) -> list[bytes]:
    await tab.do("Page.navigate", url=url)
    async with asyncio.timeout(30.0):
        while not await tab.is_true("document.body && document.body.classList.contains('-first-byte')"):
            await asyncio.sleep(0.1)
    await asyncio.sleep(2.0)  # the welcome fades
    out = [await tab.picture(clip=TOP), await tab.picture()]
    async with asyncio.timeout(30.0):
        while not looks(top := await tab.picture(clip=TOP)):
            await tab.press(key)
            await asyncio.sleep(1.0)
    return [*out, top, await tab.picture()]


async def _port(file: Path) -> int:
    async with asyncio.timeout(20.0):
        while not file.exists() or not file.read_text():
            await asyncio.sleep(0.05)
    return int(file.read_text().split()[0])
