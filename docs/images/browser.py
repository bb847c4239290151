"""Pages in a headless Chromium, driven by the DevTools protocol over a pair of pipes.

https://chromedevtools.github.io/devtools-protocol
"""

import base64
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, Final

PROGRAMS: Final = ("chromium", "chromium-browser", "google-chrome")
_OPTIONS: Final = (
    "--headless=new",
    "--remote-debugging-pipe",
    "--no-sandbox",  # which root can't use, as in a container
    "--disable-gpu",
    "--force-color-profile=srgb",
    "--font-render-hinting=none",
)
_HEIGHT: Final = 900  # of the window [px]
# the program reads commands from descriptor 3 and writes to descriptor 4
_SHELL: Final = 'exec "$@" 3<&0 4>&1'


def chromium() -> str | None:
    """Path of a Chromium; None if there is none."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


@dataclass(frozen=True)
class View:
    """How a page is looked at."""

    width: int  # of the window [px]
    dark: bool = False
    scale: float = 1.0  # pixels of a picture per pixel of the page
    touch: bool = False  # whether fingers point


class Browser:
    """A browser with one tab."""

    def __init__(self, process: "subprocess.Popen[bytes]") -> None:
        self.errors: list[str] = []
        """What the page has written to the console as an error, or thrown."""
        self._process = process
        self._numbers = count(1)
        self._loaded = False
        self._session: str | None = None
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        attached = self._call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self._call(f"{domain}.enable")

    def open(self, address: str, view: View) -> None:
        """Open a page and wait until it is loaded and drawn; `errors` are those of this page."""
        colours = {"name": "prefers-color-scheme", "value": "dark" if view.dark else "light"}
        self._call("Emulation.setEmulatedMedia", features=[colours])
        self._size(view, _HEIGHT)
        self._loaded = False
        self.errors.clear()
        self._call("Page.navigate", url=address)
        while not self._loaded:
            self._read()
        self.value("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def value(self, expression: str) -> Any:
        """The value of an expression in JavaScript, awaited if it is a promise."""
        reply = self._call(
            "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in reply:
            raise ValueError(f"{expression}: {reply['exceptionDetails']}")
        return reply["result"].get("value")

    def picture(self, view: View, height: int | None = None, top: int = 0) -> bytes:
        """A PNG of the open page, from `top` on, by default to its end [px]."""
        whole = int(self.value("document.documentElement.scrollHeight"))
        height = whole - top if height is None else height
        clip = {"x": 0, "y": top, "width": view.width, "height": height, "scale": 1}
        shot = self._call("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)
        return base64.b64decode(shot["data"])

    def _size(self, view: View, height: int) -> None:
        self._call(
            "Emulation.setDeviceMetricsOverride",
            width=view.width,
            height=height,
            deviceScaleFactor=view.scale,
            mobile=view.touch,
        )
        self._call("Emulation.setTouchEmulationEnabled", enabled=view.touch)

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol, and return its result."""
        number = next(self._numbers)
        message: dict[str, Any] = {"id": number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(message).encode() + b"\0")
        self._process.stdin.flush()
        while True:
            reply = self._read()
            if reply.get("id") == number:
                if "error" in reply:
                    raise ValueError(f"{method}: {reply['error']}")
                result: dict[str, Any] = reply["result"]
                return result

    def _read(self) -> dict[str, Any]:
        """The next message; events are noted."""
        assert self._process.stdout is not None
        text = bytearray()
        while (byte := self._process.stdout.read(1)) != b"\0":
            if not byte:
                raise EOFError("the browser has ended")
            text += byte
        message: dict[str, Any] = json.loads(text)
        self._note(message.get("method"), message.get("params", {}))
        return message

    def _note(self, event: str | None, about: dict[str, Any]) -> None:
        """Note that a page is loaded, or an error."""
        if event == "Page.loadEventFired":
            self._loaded = True
        elif event == "Runtime.exceptionThrown":
            self.errors.append(str(about["exceptionDetails"]))
        elif event == "Runtime.consoleAPICalled" and about["type"] in ("error", "assert"):
            self.errors.append(str(about["args"]))
        elif event == "Log.entryAdded" and about["entry"]["level"] == "error":
            self.errors.append(about["entry"]["text"])


@contextmanager
def browser() -> Iterator[Browser]:
    """A browser, for the length of a block; raises FileNotFoundError where there is none."""
    program = chromium()
    if program is None:
        raise FileNotFoundError(f"none of {', '.join(PROGRAMS)} is installed")
    with tempfile.TemporaryDirectory(prefix="chromium-", ignore_cleanup_errors=True) as profile:
        command = ["sh", "-c", _SHELL, "sh", program, *_OPTIONS, f"--user-data-dir={profile}"]
        with subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "HOME": profile},
            start_new_session=True,
        ) as process:
            try:
                yield Browser(process)
            finally:
                process.terminate()


def address(file: Path) -> str:
    """The address of a file."""
    return file.resolve().as_uri()
