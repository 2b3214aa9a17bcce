"""One headless Chromium for all tests of a worker, driven by its DevTools protocol over two pipes.

A test opens pages of its own: each has a new browser context, so it shares no cache, storage or setting.
"""

import base64
import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

LONGEST_S = 300.0  # a browser that is silent for longer hangs
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
QUIET = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
]


class Browser:
    """A running browser."""

    def __init__(self, requests: int, answers: int) -> None:
        self._requests, self._answers = requests, answers
        self._rest, self._count = b"", 0
        self._events: dict[str, list[dict[str, Any]]] = {}  # by session: those of open pages

    def send(self, method: str, session: str = "", **params: Any) -> dict[str, Any]:
        """Call a method of the protocol, of a page's session if one is given; return its result."""
        self._count += 1
        request = {"id": self._count, "method": method, "params": params}
        request |= {"sessionId": session} if session else {}
        os.write(self._requests, json.dumps(request).encode() + b"\0")
        while True:
            message = self.receive()
            if message.get("id") == self._count:
                assert "error" not in message, message["error"]
                return message["result"]

    def receive(self) -> dict[str, Any]:
        """Return the next message; an event of an open page is kept for it, too."""
        while b"\0" not in self._rest:
            assert select.select([self._answers], [], [], LONGEST_S)[0], "the browser does not answer"
            more = os.read(self._answers, 1 << 20)
            assert more, "the browser has ended"
            self._rest += more
        text, _, self._rest = self._rest.partition(b"\0")
        message = json.loads(text)
        self._events.get(message.get("sessionId", ""), []).append(message)
        return message

    @contextmanager
    def page(self, path: Path | None = None, **size: int) -> Iterator["Page"]:
        """Open an empty page, or a file (see `Page.open`), and close it."""
        context = self.send("Target.createBrowserContext")["browserContextId"]
        target = self.send("Target.createTarget", url="about:blank", browserContextId=context)["targetId"]
        session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        page = Page(self, session, self._events.setdefault(session, []))
        if path is not None:
            page.open(path, **size)
        try:
            yield page
        finally:
            del self._events[session]
            self.send("Target.disposeBrowserContext", browserContextId=context)


class Page:
    """An open page; `events` are what the protocol reported of it."""

    def __init__(self, browser: Browser, session: str, events: list[dict[str, Any]]) -> None:
        self._browser, self._session, self.events = browser, session, events
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **params: Any) -> dict[str, Any]:
        """Call a method of the protocol on this page; return its result."""
        return self._browser.send(method, self._session, **params)

    def open(self, path: Path, width: int = 1400, height: int = 1000) -> None:
        """Open a file in a window of a size, and wait until it is loaded."""
        self.resize(width, height)
        self.send("Page.navigate", url=path.as_uri())
        while not self._reported("Page.loadEventFired"):
            self._browser.receive()

    def resize(self, width: int, height: int = 1000) -> None:
        """Give the window another size."""
        size = {"width": width, "height": height}
        self.send("Emulation.setDeviceMetricsOverride", **size, deviceScaleFactor=1, mobile=False)

    def prefer(self, feature: str, value: str) -> None:
        """Set what the reader prefers, such as the colour scheme."""
        self.send("Emulation.setEmulatedMedia", features=[{"name": f"prefers-{feature}", "value": value}])

    def value(self, expression: str) -> Any:
        """Return the value of an expression in the page, where the page's policy does not apply to it."""
        answer = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def wait(self, expression: str) -> None:
        """Wait until an expression is true."""
        self.until(lambda: self.value(expression), expression)

    def until(self, seen: Callable[[], object], name: str) -> None:
        """Wait until something is seen."""
        end = time.monotonic() + LONGEST_S
        while not seen():
            assert time.monotonic() < end, f"never true: {name}"
            time.sleep(0.02)

    def press(self, key: str, shift: bool = False) -> None:
        """Press and release a key."""
        given = {"key": key, "modifiers": 8 * shift}
        self.send("Input.dispatchKeyEvent", type="rawKeyDown", **given)
        self.send("Input.dispatchKeyEvent", type="keyUp", **given)

    def picture(self, selector: str | None = None) -> bytes:
        """Return a PNG of the window, or of what an element shows."""
        if selector is None:
            return base64.b64decode(self.send("Page.captureScreenshot")["data"])
        box = self.value(
            f"(e => {{ e.scrollIntoView({{block: 'nearest'}}); const {{x, y, width, height}} = "
            "e.getBoundingClientRect(); return {x: x + scrollX, y: y + scrollY, width, height}; })"
            f"(document.querySelector({json.dumps(selector)}))"
        )
        shot = self.send("Page.captureScreenshot", clip=box | {"scale": 1})
        return base64.b64decode(shot["data"])

    def printed(self) -> bytes:
        """Return the page on paper, as PDF."""
        return base64.b64decode(self.send("Page.printToPDF")["data"])

    def blocked(self) -> list[str]:
        """Return what the page's policy refused, in the browser's words."""
        said = [event["entry"]["text"] for event in self._reported("Log.entryAdded")]
        return [text for text in said if "Content Security Policy" in text]

    def asked(self) -> set[str]:
        """Return the addresses that the page asked for; what its policy refused was not asked for."""
        failed = self._reported("Network.loadingFailed")
        refused = {event["requestId"] for event in failed if event.get("blockedReason") == "csp"}
        sent = self._reported("Network.requestWillBeSent")
        sockets = {event["url"] for event in self._reported("Network.webSocketCreated")}
        return sockets | {event["request"]["url"] for event in sent if event["requestId"] not in refused}

    def _reported(self, method: str) -> list[dict[str, Any]]:
        return [event["params"] for event in self.events if event.get("method") == method]


@contextmanager
def chromium(profile: Path) -> Iterator[Browser]:
    """Start a browser with an empty profile, and end it; the test is skipped where none is installed."""
    program = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if program is None:
        pytest.skip(f"no browser ({', '.join(BROWSERS)}) is installed")
    from_test, to_browser = os.pipe()
    from_browser, to_test = os.pipe()
    # The browser reads requests from descriptor 3 and writes answers to descriptor 4.
    shell = f'exec "$@" 3<&{from_test} 4>&{to_test}'
    options = [*QUIET, f"--user-data-dir={profile}", "--remote-debugging-pipe", "about:blank"]
    process = subprocess.Popen(
        ["bash", "-c", shell, "chromium", program, *options],
        pass_fds=(from_test, to_test),
        stderr=subprocess.DEVNULL,
    )
    os.close(from_test)
    os.close(to_test)
    try:
        yield Browser(to_browser, from_browser)
    finally:
        os.close(to_browser)  # which ends the browser
        os.close(from_browser)
        process.wait(30)
