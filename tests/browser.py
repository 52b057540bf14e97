"""A headless Chromium, driven over WebDriver by the few commands that tests need. It sees files and no network."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import urllib.request
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np

FLAGS = (
    *("--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage"),
    *("--force-device-scale-factor=1", "--host-resolver-rules=MAP * ~NOTFOUND"),
)


def installed() -> bool:
    return all(shutil.which(program) for program in ("chromium", "chromedriver"))


class Browser:
    """One page at a time, in a profile of its own."""

    def __init__(self, profile: Path, size: tuple[int, int] = (1000, 700)) -> None:
        self._driver = subprocess.Popen(["chromedriver", "--port=0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        assert self._driver.stdout is not None
        port = next(found[1] for line in self._driver.stdout if (found := re.search(r"started successfully on port (\d+)", line)))
        self._base = f"http://localhost:{port}/session"
        arguments = [*FLAGS, f"--user-data-dir={profile}", f"--window-size={size[0]},{size[1]}"]
        wanted = {"capabilities": {"alwaysMatch": {"goog:chromeOptions": {"args": arguments}, "goog:loggingPrefs": {"browser": "ALL"}}}}
        self._base += f"/{self._post('', wanted)['sessionId']}"

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            self._send(urllib.request.Request(self._base, method="DELETE"))
        finally:
            self._driver.terminate()
            self._driver.wait(30)
            assert self._driver.stdout is not None
            self._driver.stdout.close()

    def open(self, page: Path) -> None:
        self._post("/url", {"url": page.resolve().as_uri()})

    def run(self, script: str, *arguments: Any) -> Any:
        """What a function of that body returns; it may `await`."""
        body = f"const done = arguments[arguments.length - 1]; (async (...arguments) => {{ {script} }})(...arguments).then(done);"
        return self._post("/execute/async", {"script": body, "args": [*arguments]})

    def press(self, key: str) -> None:
        """Press and release one key."""
        moves = [{"type": kind, "value": key} for kind in ("keyDown", "keyUp")]
        self._post("/actions", {"actions": [{"type": "key", "id": "keys", "actions": moves}]})

    def screenshot(self, path: Path | None = None) -> np.ndarray:
        """What the window shows, uint8 RGB [H, W, 3], once it has been drawn; also written to `path`."""
        self.run("for (let i = 0; i < 3; i++) await new Promise(requestAnimationFrame);")
        data = base64.b64decode(self._send(urllib.request.Request(f"{self._base}/screenshot")))
        if path is not None:
            path.write_bytes(data)
        return cv2.cvtColor(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)

    def messages(self) -> list[str]:
        """What the page wrote to the console since it was asked last: errors, and what its security policy refused."""
        return [entry["message"] for entry in self._post("/se/log", {"type": "browser"})]

    def _post(self, path: str, values: dict[str, Any]) -> Any:
        return self._send(urllib.request.Request(self._base + path, json.dumps(values).encode(), {"Content-Type": "application/json"}))

    def _send(self, request: urllib.request.Request) -> Any:
        with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(request, timeout=60) as answer:
            return json.load(answer)["value"]
