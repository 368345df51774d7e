"""A headless Chromium on a page, spoken to in the DevTools protocol over pipes."""

import base64
import json
import os
import select
import shutil
import subprocess
from pathlib import Path
from time import monotonic, sleep
from types import TracebackType
from typing import Any

COMMAND = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
PATIENCE_S = 60
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--remote-debugging-pipe",
)  # fmt: skip


WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")  # drawn without a GPU


class Chromium:
    """One page, a file's or (by its URL) a server's; `complaints` holds what the browser says on its console: errors,
    and what the page's policy forbids."""

    def __init__(self, page: Path | str, profile: Path, size: tuple[int, int] = (1240, 900)) -> None:
        assert COMMAND is not None
        to_browser, commands = os.pipe()
        answers, from_browser = os.pipe()
        # the protocol is read from descriptor 3 and written to 4
        shell = f'exec "$@" 3<&{to_browser} 4>&{from_browser}'
        command = ["bash", "-c", shell, "bash", COMMAND, *FLAGS, *(WEBGL if isinstance(page, str) else ()),
                   f"--user-data-dir={profile}", "about:blank"]  # fmt: skip
        self._process = subprocess.Popen(command, pass_fds=(to_browser, from_browser), stderr=subprocess.DEVNULL)
        os.close(to_browser)
        os.close(from_browser)
        self._commands, self._answers = os.fdopen(commands, "wb", 0), os.fdopen(answers, "rb")
        self._pending, self._number, self._session = b"", 0, ""
        self.complaints: list[str] = []
        self.events: list[dict[str, Any]] = []
        target = next(t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page")
        found = self.call("Target.attachToTarget", targetId=target["targetId"], flatten=True)
        self._session = found["sessionId"]
        for domain in ("Runtime", "Log", "Page"):
            self.call(f"{domain}.enable")
        width, height = size
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.call("Page.navigate", url=page if isinstance(page, str) else page.resolve().as_uri())
        while not any(e["method"] == "Page.loadEventFired" for e in self.events):
            self._read()
        self.settle()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Sends a command and returns its result."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        self._commands.write(json.dumps(message).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return dict(answer["result"])

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression (awaited), as JSON has it."""
        found = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def wait_for(self, expression: str) -> None:
        """Waits until a JavaScript expression is true."""
        end = monotonic() + PATIENCE_S
        while not self.evaluate(expression):
            assert monotonic() < end, f"it does not come: {expression}"
            sleep(0.05)

    def picture(self) -> bytes:
        """What the window shows, as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def settle(self) -> None:
        """Waits for two frames, in which everything that was asked for is drawn."""
        self.evaluate("new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(() => go(0))))")

    def middle_of(self, selector: str) -> tuple[float, float]:
        """Brings an element to the middle of the window and returns where its own middle is."""
        x, y = self.evaluate(
            f"(() => {{ const e = document.querySelector({json.dumps(selector)});"
            " e.scrollIntoView({block: 'center'});"
            " const r = e.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; })()"
        )
        self.settle()
        return x, y

    def drag(self, start: tuple[float, float], by: tuple[float, float], modifiers: int = 0) -> None:
        """Presses the mouse, moves it in two steps, lets go."""
        x, y = start
        places = [("mousePressed", 0.0), ("mouseMoved", 0.5), ("mouseMoved", 1.0), ("mouseReleased", 1.0)]
        for kind, share in places:
            self.call(
                "Input.dispatchMouseEvent", type=kind, x=x + share * by[0], y=y + share * by[1], button="left",
                buttons=0 if kind == "mouseReleased" else 1, clickCount=1, modifiers=modifiers,
            )  # fmt: skip
        self.settle()

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._pending:
            assert select.select([self._answers], [], [], PATIENCE_S)[0], "the browser does not answer"
            piece = os.read(self._answers.fileno(), 1 << 16)
            assert piece, "the browser has gone"
            self._pending += piece
        raw, self._pending = self._pending.split(b"\0", 1)
        message: dict[str, Any] = json.loads(raw)
        if "method" in message:
            self.events.append(message)
            if message["method"] in ("Runtime.exceptionThrown", "Log.entryAdded", "Runtime.consoleAPICalled"):
                self.complaints.append(json.dumps(message["params"]))
        return message

    def __enter__(self) -> "Chromium":
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends the browser."""
        self._commands.close()  # which is its sign to leave
        try:
            self._process.wait(5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._answers.close()
