"""Diagnose every case, each in its own process with a time limit. Resumable; never opens the answers.

python benchmarks/blind/run.py CASES -o RUNS --limit 300 --command "inertiax diagnose"
"""

import argparse
import json
import shlex
import subprocess
import sys
import time
from pathlib import Path


INERTIAX = [sys.executable, "-c", "from inertiax.cli import main; main()", "diagnose"]


def diagnose(command: list[str], case: Path, out: Path, limit: float) -> dict:
    """Run `command CASE -o OUT`; **returns** status, seconds and the last lines of standard error."""
    out.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()
    try:
        done = subprocess.run(
            [*command, str(case), "-o", str(out)], capture_output=True, text=True, timeout=limit
        )
        status, tail = done.returncode, done.stderr[-800:]
    except subprocess.TimeoutExpired:
        status, tail = "timeout", ""
    seconds = time.perf_counter() - start
    return {"status": status, "seconds": round(seconds, 2), "stderr": tail}


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--limit", type=float, default=300.0, help="seconds a case")
    parser.add_argument("--command", help="instead of `inertiax diagnose` of this Python")
    parser.add_argument("--budget", type=float, help="stop starting cases after so many seconds")
    args = parser.parse_args()
    start = time.perf_counter()
    folders = sorted(p for p in args.cases.glob("case-*") if (p / "campaign.toml").exists())
    for k, folder in enumerate(folders, start=1):
        record = args.output / folder.name / "run.json"
        if record.exists():
            continue
        if args.budget and time.perf_counter() - start > args.budget:
            print(f"{k - 1} of {len(folders)} done; run again to go on")
            return
        command = shlex.split(args.command) if args.command else INERTIAX
        result = diagnose(command, folder, record.parent, args.limit)
        record.write_text(json.dumps(result) + "\n")
        print(f"{folder.name}: {result['status']}, {result['seconds']} s", flush=True)
    print(f"{len(folders)} of {len(folders)} done")


if __name__ == "__main__":
    main()
