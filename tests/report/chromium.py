"""A page in a headless Chromium that a test drives: its DevTools protocol over two pipes."""

import base64
import json
import os
import select
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .test_browser import QUIET

LONGEST_S = 60.0


class Page:
    """An open page."""

    def __init__(self, requests: int, answers: int) -> None:
        self._requests, self._answers = requests, answers
        self._rest, self._count, self._session = b"", 0, ""
        self.events: list[dict[str, Any]] = []
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **params: Any) -> dict[str, Any]:
        """Call a method of the protocol; return its result."""
        self._count += 1
        request = {"id": self._count, "method": method, "params": params}
        request |= {"sessionId": self._session} if self._session else {}
        os.write(self._requests, json.dumps(request).encode() + b"\0")
        while True:
            message = self._next()
            if message.get("id") == self._count:
                assert "error" not in message, message["error"]
                return message["result"]
            self.events.append(message)

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            assert select.select([self._answers], [], [], LONGEST_S)[0], "the browser does not answer"
            self._rest += os.read(self._answers, 1 << 20)
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)

    def open(self, path: Path, width: int = 1400, height: int = 1000) -> None:
        """Open a file in a window of a size, and wait until it is loaded."""
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        self.send("Page.navigate", url=path.as_uri())
        while not any(event["method"] == "Page.loadEventFired" for event in self.events):
            self.events.append(self._next())

    def value(self, expression: str) -> Any:
        """Return the value of an expression in the page."""
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

    def picture(self, selector: str) -> bytes:
        """Return a PNG of what an element shows."""
        box = self.value(
            f"(({{x, y, width, height}}) => ({{x: x + scrollX, y: y + scrollY, width, height}}))"
            f"(document.querySelector({json.dumps(selector)}).getBoundingClientRect())"
        )
        clip = box | {"scale": 1}
        shot = self.send("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)
        return base64.b64decode(shot["data"])


@contextmanager
def chromium(browser: str, profile: Path) -> Iterator[Page]:
    """Start a browser with an empty page, and end it."""
    from_page, to_browser = os.pipe()
    from_browser, to_page = os.pipe()
    # The browser reads requests from descriptor 3 and writes answers to descriptor 4.
    shell = f'exec "$@" 3<&{from_page} 4>&{to_page}'
    options = [*QUIET, f"--user-data-dir={profile}", "--remote-debugging-pipe", "about:blank"]
    process = subprocess.Popen(
        ["bash", "-c", shell, "chromium", browser, *options],
        pass_fds=(from_page, to_page),
        stderr=subprocess.DEVNULL,
    )
    os.close(from_page)
    os.close(to_page)
    try:
        yield Page(to_browser, from_browser)
    finally:
        os.close(to_browser)  # which ends the browser
        os.close(from_browser)
        process.wait(30)
