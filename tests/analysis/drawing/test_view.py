"""The view that can be turned is opened by a browser without a network: it shows the bodies, and they turn."""

import asyncio
import base64
import io
import shutil
import subprocess
import time

import aiohttp
import numpy as np
import pytest
from PIL import Image

from analysis.drawing.bodies import Body, scale_of
from analysis.drawing.view import write_view

_CHROMIUM = shutil.which("chromium")
_OPTIONS = [
    "--headless=new", "--no-sandbox", "--no-first-run", "--remote-debugging-port=0", "--window-size=900,500",
    "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking",
    "--host-resolver-rules=MAP * ~NOTFOUND",
]  # fmt: skip
_PATIENCE = 60  # s, of a busy machine


class Page:
    """A page of a browser, by the DevTools protocol."""

    def __init__(self, socket):
        self.socket, self.n_sent, self.errors = socket, 0, []

    async def call(self, method, **parameters):
        self.n_sent += 1
        await self.socket.send_json({"id": self.n_sent, "method": method, "params": parameters})
        while True:
            message = await self.socket.receive_json()
            parameters = message.get("params", {})
            if message.get("method") == "Runtime.exceptionThrown":
                self.errors.append(parameters["exceptionDetails"])
            if message.get("method") == "Runtime.consoleAPICalled" and parameters["type"] == "error":
                self.errors.append(parameters["args"])
            if message.get("method") == "Log.entryAdded" and parameters["entry"]["level"] == "error":
                self.errors.append(parameters["entry"])
            if message.get("id") == self.n_sent:
                return message.get("result")  # None: the page was not ready

    async def picture(self):
        while not (result := await self.call("Page.captureScreenshot")):
            await asyncio.sleep(0.1)
        data = result["data"]
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"), dtype=int)

    async def picture_that(self, is_wanted):
        deadline = time.monotonic() + _PATIENCE
        while not is_wanted(picture := await self.picture()) and time.monotonic() < deadline:
            await asyncio.sleep(0.2)
        return picture

    async def drag(self, start, end):
        """Holds the left button from start to end (pixels)."""
        held = {"button": "left", "buttons": 1}
        await self.call(
            "Input.dispatchMouseEvent", type="mousePressed", x=start[0], y=start[1], clickCount=1, **held
        )
        for share in (0.25, 0.5, 0.75, 1):
            x, y = (a + share * (b - a) for a, b in zip(start, end, strict=True))
            await self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, **held)
        await self.call(
            "Input.dispatchMouseEvent", type="mouseReleased", x=end[0], y=end[1], clickCount=1, button="left"
        )


async def _port_of(home):
    file = home / "DevToolsActivePort"
    deadline = time.monotonic() + _PATIENCE
    while not (file.exists() and file.read_text()) and time.monotonic() < deadline:
        await asyncio.sleep(0.05)
    return file.read_text().split()[0]


def coloured(picture):
    return float((np.ptp(picture, axis=2) > 60).mean())


async def _turn(file, home):
    """Pictures before and after the view is turned, and the errors on the console."""
    async with aiohttp.ClientSession() as session:
        async with session.get(f"http://127.0.0.1:{await _port_of(home)}/json") as answer:
            (target,) = [page for page in await answer.json() if page["type"] == "page"]
        async with session.ws_connect(target["webSocketDebuggerUrl"], max_msg_size=0) as socket:
            page = Page(socket)
            for domain in ("Page", "Runtime", "Log"):
                await page.call(f"{domain}.enable")
            await page.call("Page.navigate", url=file.as_uri())
            await page.picture_that(lambda picture: coloured(picture) > 0.02)
            first = await page.picture()
            await page.drag((300, 250), (520, 330))
            second = await page.picture_that(lambda picture: np.abs(picture - first).max() > 100)
            return first, second, page.errors


@pytest.mark.skipif(not _CHROMIUM, reason="needs chromium, which ./testbed test installs")
def test_view_is_shown_and_turned_by_a_browser_without_a_network(ball, tmp_path):
    X, F = ball[0] * [2, 1, 0.5], ball[1]
    error = np.linspace(1, 90, len(X))
    bodies = {"finite elements": Body(X, F, 0.1 * X), "springs": Body(X, F, 0.2 * X, error)}
    write_view(tmp_path / "view.html", "a ball & more", bodies, scale_of([error]), 1)
    text = (tmp_path / "view.html").read_text()
    assert "<title>a ball &amp; more</title>" in text
    assert len(text) < 3e6
    home = tmp_path / "browser"
    browser = subprocess.Popen([_CHROMIUM, *_OPTIONS, f"--user-data-dir={home}"], stderr=subprocess.DEVNULL)
    try:
        first, second, errors = asyncio.run(_turn(tmp_path / "view.html", home))
    finally:
        browser.terminate()
        browser.wait()
    assert errors == []
    assert 0.02 < coloured(first) < 0.5
    # What is turned looks different and is still there.
    assert (np.abs(first - second).max(axis=2) > 40).mean() > 0.01
    assert 0.01 < coloured(second) < 0.5
