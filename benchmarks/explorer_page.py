"""Claims: the explorer's page of 100 000 residuals has at most 1.5 MB, opens in 1 s and asks nothing of a network.

Residuals of `tests/test_explorer.py`, 33 333 blocks of three channels. Seconds are those of a headless Chromium that
has started, from its navigation to the page until a figure stands in it and the frame after that is drawn; medians.

    python benchmarks/explorer_page.py [--runs 5] [--picture FILE.png]
"""

import argparse
import statistics
import sys
import tempfile
import time
from pathlib import Path


sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from browser import Browser  # noqa: E402
from inertiax.report.explorer import write_explorer  # noqa: E402
from test_explorer import made  # noqa: E402


BLOCKS = 33_333
MEGABYTES, SECONDS = 1.5, 1.0
DRAWN = """new Promise(done => {
  const look = () => document.querySelector('canvas') || document.querySelector('.bk-Figure')
    || [...document.querySelectorAll('*')].some(e => e.shadowRoot)
    ? requestAnimationFrame(() => done(performance.now())) : requestAnimationFrame(look);
  look();
})"""
ASKED = "performance.getEntriesByType('resource').map(e => e.name)"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--picture", type=Path, help="what stood there at that moment")
    asked_for = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, Browser() as browser:
        page = Path(folder) / "explorer.html"
        write_explorer([made(BLOCKS)], page, title="Residuals")
        seconds, asked = [], set()
        for _ in range(asked_for.runs):
            start = time.perf_counter()
            browser.open(page, width=1280)
            browser.value(DRAWN)
            seconds.append(time.perf_counter() - start)
            asked |= {a for a in browser.value(ASKED) if a.startswith("http")}
            assert not browser.errors, browser.errors
        if asked_for.picture:
            browser.shoot(asked_for.picture)
        size = page.stat().st_size / 1e6
    middle = statistics.median(seconds)
    print(
        f"{3 * BLOCKS} residuals: {size:.2f} MB; opens in {middle:.2f} s, {max(seconds):.2f} at most"
    )
    print(f"asked of a network: {', '.join(sorted(asked)) or 'nothing'}")
    print("reached" if size <= MEGABYTES and middle <= SECONDS and not asked else "missed")


if __name__ == "__main__":
    main()
