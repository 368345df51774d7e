"""A headless Chromium on a page, spoken to in the DevTools protocol over pipes."""

import base64
import json
import os
import select
import shutil
import subprocess
from pathlib import Path
from time import monotonic, sleep
from typing import Any

COMMAND = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
PATIENCE_S = 60
FLAGS = "--headless --no-sandbox --no-first-run --hide-scrollbars --disable-background-networking --disable-sync"
WEBGL = "--use-angle=swiftshader --enable-unsafe-swiftshader --ignore-gpu-blocklist"  # drawn without a GPU


class Chromium:
    """One page, a file's or (by its URL) a server's; `complaints` holds what the browser says on its console: errors,
    and what the page's policy forbids."""

    def __init__(self, page: Path | str, profile: Path, size: tuple[int, int] = (1240, 900)) -> None:
        assert COMMAND is not None
        to_browser, commands = os.pipe()
        answers, from_browser = os.pipe()
        # the protocol is read from descriptor 3 and written to 4
        shell = ["bash", "-c", f'exec "$@" 3<&{to_browser} 4>&{from_browser}', "bash", COMMAND]
        flags = [*FLAGS.split(), *WEBGL.split(), "--remote-debugging-pipe", f"--user-data-dir={profile}"]
        descriptors = (to_browser, from_browser)
        self._process = subprocess.Popen(
            [*shell, *flags, "about:blank"], pass_fds=descriptors, stderr=subprocess.DEVNULL
        )
        for descriptor in descriptors:
            os.close(descriptor)
        self._commands, self._answers = os.fdopen(commands, "wb", 0), os.fdopen(answers, "rb")
        self._pending, self._number, self._session = b"", 0, ""
        self.complaints: list[str] = []
        self._events: list[str] = []
        target = next(t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=target["targetId"], flatten=True)["sessionId"]
        for domain in ("Runtime", "Log", "Page"):
            self.call(f"{domain}.enable")
        width, height = size
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.call("Page.navigate", url=page if isinstance(page, str) else page.resolve().as_uri())
        while "Page.loadEventFired" not in self._events:
            self._read()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Sends a command and returns its result."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        self._commands.write(json.dumps(message | ({"sessionId": self._session} if self._session else {})).encode())
        self._commands.write(b"\0")
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

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._pending:
            assert select.select([self._answers], [], [], PATIENCE_S)[0], "the browser does not answer"
            piece = os.read(self._answers.fileno(), 1 << 16)
            assert piece, "the browser has gone"
            self._pending += piece
        raw, self._pending = self._pending.split(b"\0", 1)
        message: dict[str, Any] = json.loads(raw)
        self._events.append(message.get("method", ""))
        if self._events[-1] in ("Runtime.exceptionThrown", "Log.entryAdded", "Runtime.consoleAPICalled"):
            self.complaints.append(json.dumps(message["params"]))
        return message

    def __enter__(self) -> "Chromium":
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Ends the browser."""
        self._process.kill()
        self._process.wait()
        self._commands.close()
        self._answers.close()
