"""A headless Chromium driven over its DevTools pipe: pages laid out at a width, errors, screenshots.

The protocol is JSON messages ended by a zero byte, on file descriptors 3 (in) and 4 (out) of the browser.
"""

import base64
import itertools
import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Self


FOUND = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
# Nothing is asked of the network; a sandbox of its own needs rights that a container lacks.
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--remote-debugging-pipe",
)
# What reaches over the window, boxes apart that scroll by themselves (tables do not have to on a desk);
# pictures that did not load; words in a figure that are cut off by it or lie on one another.
_FAULTS = """(() => {
  const wide = window.innerWidth, faults = [];
  const whole = document.documentElement.scrollWidth;
  if (whole > wide) faults.push(`the page is ${whole} wide`);
  for (const e of document.querySelectorAll('body *')) {
    const right = e.getBoundingClientRect().right;
    if (right > wide + 1 && !e.closest('.wide, .scroll')) faults.push(`${e.tagName} to ${right}`);
    if (e.tagName === 'IMG' && !e.naturalWidth) faults.push('broken image');
  }
  if (wide > 1000)
    for (const e of document.querySelectorAll('.wide, .scroll'))
      if (e.scrollWidth > e.clientWidth + 1) faults.push(`${e.textContent.trim().slice(0, 40)} scrolls`);
  const round = (a, b) => a.left >= b.left - 1 && a.right <= b.right + 1
    && a.top >= b.top - 1 && a.bottom <= b.bottom + 1;
  const over = (a, b) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 2
    && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 3;
  for (const figure of document.querySelectorAll('figure svg')) {
    const outer = figure.getBoundingClientRect();
    const words = [...figure.querySelectorAll('g[id*="text_"]')].map(e => [e.id, e.getBoundingClientRect()]);
    words.forEach(([name, box], k) => {
      if (box.width && !round(box, outer)) faults.push(`${name} is cut off`);
      for (const [other, its] of words.slice(k + 1)) if (over(box, its)) faults.push(`${name} on ${other}`);
    });
  }
  return faults;
})()"""


class Browser:
    """One browser process; use as a context."""

    def __init__(self):
        assert FOUND is not None
        self._profile = tempfile.mkdtemp()
        inward, self._write = os.pipe()
        self._read, outward = os.pipe()
        # The shell puts the pipes at 3 and 4, whatever their numbers are here.
        command = f'exec "$0" "$@" 3<&{inward} 4>&{outward}'
        arguments = [FOUND, *FLAGS, f"--user-data-dir={self._profile}", "about:blank"]
        self._process = subprocess.Popen(
            ["bash", "-c", command, *arguments],
            pass_fds=(inward, outward),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(inward)
        os.close(outward)
        self._numbers = itertools.count(1)
        self._rest = b""
        self.errors: list[str] = []
        target = self._ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._ask("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Log"):
            self._ask(f"{domain}.enable")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._write)
        os.close(self._read)
        shutil.rmtree(self._profile, ignore_errors=True)

    def open(self, page: Path, *, width: int, dark: bool = False) -> None:
        """Lay the page out in a window of so many pixels; its errors are in `errors` afterwards."""
        self.visit(page.resolve().as_uri(), width=width, dark=dark)

    def visit(self, address: str, *, width: int, dark: bool = False) -> None:
        """The same of a page that a server has."""
        self.errors.clear()
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self._ask("Emulation.setEmulatedMedia", features=scheme)
        self._ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=900,
            deviceScaleFactor=1,
            mobile=width < 600,
        )
        self._ask("Page.navigate", url=address)
        while self._next().get("method") != "Page.loadEventFired":
            pass

    def faults(self) -> list[str]:
        """What does not fit in the page that is open."""
        return self.value(_FAULTS)

    def value(self, expression: str):
        """What an expression in the page that is open has as its value; a promise is waited for."""
        found = self._ask(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        return found["result"].get("value")

    def shoot(self, picture: Path) -> None:
        """Write the whole page that is open as PNG."""
        shot = self._ask("Page.captureScreenshot", captureBeyondViewport=True)
        picture.write_bytes(base64.b64decode(shot["data"]))

    def _ask(self, method: str, **parameters: object) -> dict:
        number = next(self._numbers)
        message: dict[str, object] = {"id": number, "method": method, "params": parameters}
        if hasattr(self, "_session"):
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == number:
                assert "error" not in answer, answer["error"]
                return answer["result"]

    def _next(self) -> dict:
        while b"\0" not in self._rest:
            more = os.read(self._read, 1 << 16)
            assert more, "the browser ended"
            self._rest += more
        text, self._rest = self._rest.split(b"\0", 1)
        message = json.loads(text)
        if message.get("method") in ("Log.entryAdded", "Runtime.exceptionThrown"):
            self.errors.append(json.dumps(message["params"]))
        return message
