"""Two runs into one place, at any moment of the first: the second is refused in a line, the first's results stand.

    python benchmarks/two_runs.py [--times 20] [--seed 0]

For a single device, a fleet and `live`. The first run is stopped (SIGSTOP) at a random moment of the second after it
has taken the lock, so that it certainly owns the results while the second one starts; then it goes on. Checked: the
second ends with status 1 or 2 and one line that says so, the first with status 0, and what is there is what a run
alone writes.
"""

import argparse
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import signals


COMMANDS = {
    "calibrate": "calibrate one -o out -q",
    "fleet": "fleet line -o out -q",
    "live": "live lively --idle 0.5 -o out -q",
}
REFUSED = ("writes there", "holds a campaign already")


def two(bench: signals.Bench, words: str, moment: float) -> tuple[str, dict[str, object]]:
    """What was wrong, and what the first run wrote."""
    command = signals.command(words.split())
    first = subprocess.Popen(
        command, cwd=bench.home, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    lock = bench.home / ".inertiax-out.lock"
    while not lock.exists() and first.poll() is None:
        time.sleep(0.002)
    time.sleep(moment)
    first.send_signal(signal.SIGSTOP)
    held = lock.exists()
    second = subprocess.run(command, cwd=bench.home, capture_output=True, text=True, timeout=300)
    first.send_signal(signal.SIGCONT)
    _, said = first.communicate(timeout=600)
    if not held:
        return "the first was done before it was stopped", bench.contents()
    wrong = "" if first.returncode == 0 else f"the first: {said[:300]} "
    told = second.stderr
    if (
        second.returncode not in (1, 2)
        or told.count("\n") != 1
        or not any(r in told for r in REFUSED)
    ):
        wrong += f"the second: {second.returncode} {told[:300]}"
    return wrong, bench.contents()


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("--times", type=int, default=20)
    asked.add_argument("--seed", type=int, default=0)
    options = asked.parse_args()
    rng, failed = random.Random(options.seed), 0
    with tempfile.TemporaryDirectory() as folder:
        bench = signals.Bench(Path(folder), "")
        signals.prepare(bench.home)
        for name, words in COMMANDS.items():
            alone = signals.command(words.split())
            subprocess.run(alone, cwd=bench.home, check=True, stdout=subprocess.DEVNULL)
            expected, refused = bench.contents(), 0
            for _ in range(options.times):
                bench.clear()
                wrong, found = two(bench, words, rng.uniform(0.0, 1.0))
                wrong += "" if found == expected else "the results differ from those of a run alone"
                wrong += f"left {bench.left_behind()}" if bench.left_behind() else ""
                refused += not wrong
                if wrong:
                    print(f"{name}: {wrong}", flush=True)
            bench.clear()
            failed += options.times - refused
            print(f"{name}: {refused} of {options.times} refused", flush=True)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
