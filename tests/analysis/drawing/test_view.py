"""The view that can be turned is opened by a browser without a network: it shows the bodies, which fill it, and they turn."""

import asyncio
import base64
import io
import json
import shutil
import subprocess
import time

import aiohttp
import numpy as np
import pytest
from PIL import Image

from analysis.drawing.bodies import Body
from analysis.drawing.view import Shown, write_view

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


_PARTS = """JSON.stringify({
  bodies: [...document.querySelectorAll(".body")].map(part => part.getBoundingClientRect()),
  names: [...document.querySelectorAll(".name")].map(part => [part.scrollWidth, part.clientWidth]),
  isParallel: windows.map(view => rendererOf(view).getActiveCamera().getParallelProjection()),
  isWide: document.documentElement.scrollWidth > innerWidth,
})"""


def filled(picture, part):
    """Shares of a part's width and height that a body covers, and whether it ends before the border."""
    left, top, width, height = (round(part[name]) for name in ("x", "y", "width", "height"))
    is_body = (picture[top : top + height, left : left + width] < 250).any(axis=2)
    rows, columns = is_body.any(axis=1).nonzero()[0], is_body.any(axis=0).nonzero()[0]
    is_whole = not (is_body[[0, -1]].any() or is_body[:, [0, -1]].any())
    return np.ptp(columns) / width, np.ptp(rows) / height, is_whole


def changed(picture, first, part):
    """Share of a part's pixels that are others than before."""
    left, top, width, height = (round(part[name]) for name in ("x", "y", "width", "height"))
    is_other = np.abs(first - picture)[top : top + height, left : left + width].max(axis=2) > 40
    return float(is_other.mean())


async def _look(file, home):
    """Pictures and parts of the page in two sizes; a picture after the view is turned; and the errors on the console."""
    async with aiohttp.ClientSession() as session:
        async with session.get(f"http://127.0.0.1:{await _port_of(home)}/json") as answer:
            (target,) = [page for page in await answer.json() if page["type"] == "page"]
        async with session.ws_connect(target["webSocketDebuggerUrl"], max_msg_size=0) as socket:
            page = Page(socket)
            for domain in ("Page", "Runtime", "Log"):
                await page.call(f"{domain}.enable")
            seen = {}
            for size in SIZES:
                shape = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False}
                await page.call("Emulation.setDeviceMetricsOverride", **shape)
                if not seen:
                    await page.call("Page.navigate", url=file.as_uri())
                await page.picture_that(lambda picture: coloured(picture) > 0.02)
                parts = await page.call("Runtime.evaluate", expression=_PARTS, returnByValue=True)
                seen[size] = await page.picture(), json.loads(parts["result"]["value"])
            first, parts = seen[SIZES[-1]]
            middle = [
                parts["bodies"][1][k] + parts["bodies"][1][n] / 2
                for k, n in (("x", "width"), ("y", "height"))
            ]
            await page.drag(middle, (middle[0] + 90, middle[1] + 40))
            turned = await page.picture_that(
                lambda picture: all(changed(picture, first, part) > 0.02 for part in parts["bodies"])
            )
            return seen, turned, page.errors


SIZES = ((1400, 700), (500, 800))


@pytest.mark.skipif(not _CHROMIUM, reason="needs chromium, which ./testbed test installs")
def test_view_is_shown_and_turned_by_a_browser_without_a_network(ball, tmp_path):
    X, F = ball[0] * [0.5, 2, 0.7], ball[1]
    error = np.linspace(1, 90, len(X))
    bodies = [
        Shown("finite elements", "the reference", Body(X, F, 0.1 * X)),
        Shown("springs, node_averaged", "error 40 %", Body(X, F, 0.1 * X, error)),
        Shown("springs, uniform", "error 90 %", Body(X, F, 0.1 * X, error[::-1])),
    ]
    write_view(tmp_path / "view.html", "a ball & more", "Drawn 3 times as large.", bodies, 3)
    text = (tmp_path / "view.html").read_text()
    assert "<title>a ball &amp; more</title>" in text and "<h1>a ball &amp; more</h1>" in text
    assert (
        "Drawn 3 times as large." in text
        and "The pale shell is the body at rest, hidden where the moved one lies outside it." in text
    )
    assert all(f">{tick}</text>" in text for tick in ("0.1", "1", "5", "20", "100"))
    assert len(text) < 3e6
    home = tmp_path / "browser"
    browser = subprocess.Popen([_CHROMIUM, *_OPTIONS, f"--user-data-dir={home}"], stderr=subprocess.DEVNULL)
    try:
        seen, turned, errors = asyncio.run(_look(tmp_path / "view.html", home))
    finally:
        browser.terminate()
        browser.wait()
    assert errors == []
    for size in SIZES:
        picture, parts = seen[size]
        assert parts["isParallel"] == [True] * 3 and not parts["isWide"]
        assert all(needed <= there for needed, there in parts["names"])
        for part in parts["bodies"]:
            width, height, is_whole = filled(picture, part)
            assert is_whole and max(width, height) == pytest.approx(0.9, abs=0.03)
        tops = sorted(part["y"] for part in parts["bodies"])
        assert (tops[0] < tops[-1]) == (size[0] == 500)  # one below the other where there is no room beside
    # What is turned looks different and is still there, and all turn with it.
    first, parts = seen[SIZES[-1]]
    for part in parts["bodies"]:
        assert max(filled(turned, part)[:2]) > 0.5
        assert changed(turned, first, part) > 0.02
