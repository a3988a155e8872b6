"""Diagnose every case with a time limit. Resumable; never opens the answers.

python benchmarks/blind/run.py CASES -o RUNS --limit 300 --command "inertiax diagnose"
python benchmarks/blind/run.py CASES -o RUNS --together --part 1/2

Each case has its own process, or with `--together` one process goes from case to case and is started anew
after a case that took too long.
"""

import argparse
import json
import select
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


class Together:
    """A diagnosing process that stays (`together.py`)."""

    def __init__(self) -> None:
        self.process: subprocess.Popen[str] | None = None

    def diagnose(self, case: Path, out: Path, limit: float) -> dict:
        """As `diagnose`; `cpu` is the processor time of the case."""
        out.mkdir(parents=True, exist_ok=True)
        if self.process is None or self.process.poll() is not None:
            self.process = subprocess.Popen(
                [sys.executable, str(Path(__file__).with_name("together.py"))],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            )  # fmt: skip
        assert self.process.stdin is not None and self.process.stdout is not None
        start = time.perf_counter()
        self.process.stdin.write(f"{case}\t{out}\n")
        self.process.stdin.flush()
        ready, _, _ = select.select([self.process.stdout], [], [], limit)
        line = self.process.stdout.readline() if ready else ""
        seconds = round(time.perf_counter() - start, 2)
        if not line:
            status = "timeout" if not ready else "died"
            self.process.kill()
            self.process.wait()
            return {"status": status, "seconds": seconds, "stderr": ""}
        status, cpu, said = line.rstrip("\n").split("\t", 2)
        return {"status": int(status), "seconds": seconds, "cpu": float(cpu), "stderr": said}


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--limit", type=float, default=300.0, help="seconds a case")
    parser.add_argument("--command", help="instead of `inertiax diagnose` of this Python")
    parser.add_argument("--together", action="store_true", help="one process for all cases")
    parser.add_argument("--part", default="1/1", help="K/N: every N-th case from the K-th on")
    parser.add_argument("--budget", type=float, help="stop starting cases after so many seconds")
    args = parser.parse_args()
    start = time.perf_counter()
    folders = sorted(p for p in args.cases.glob("case-*") if (p / "campaign.toml").exists())
    part, parts = map(int, args.part.split("/"))
    folders = folders[part - 1 :: parts]
    staying = Together() if args.together else None
    for k, folder in enumerate(folders, start=1):
        record = args.output / folder.name / "run.json"
        if record.exists():
            continue
        if args.budget and time.perf_counter() - start > args.budget:
            print(f"{k - 1} of {len(folders)} done; run again to go on")
            return
        command = shlex.split(args.command) if args.command else INERTIAX
        if staying is not None:
            result = staying.diagnose(folder, record.parent, args.limit)
        else:
            result = diagnose(command, folder, record.parent, args.limit)
        record.write_text(json.dumps(result) + "\n")
        print(f"{folder.name}: {result['status']}, {result['seconds']} s", flush=True)
    print(f"{len(folders)} of {len(folders)} done")


if __name__ == "__main__":
    main()
