"""Where the processor time of each command goes: imports, tracing, compilation, figures and report, the rest.

Every command is a process of its own, run once to fill a cache of compiled programs and once more to be measured.
JAX's own monitoring events tell what tracing took, and compiling or the reading of what was compiled before; `cProfile`
(in a third run, which it slows down) what share figures and the report had of all that ran. Imports are those of the
command's modules before it begins. Processor seconds of all threads, but what JAX tells, which is by the clock: where
other work shares the machine these are too large. And the largest resident memory.

    INERTIAX_RECORDINGS=... python benchmarks/profile_commands.py [--only diagnose ...] [--json FILE]
"""

import argparse
import cProfile
import json
import os
import pstats
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import command_times


TRACING = ("jaxpr_trace_duration", "jaxpr_to_mlir_module_duration")
COMPILING = ("backend_compile_duration",)  # reading of what the cache holds is within it
MODULES = {
    "diagnose": "inertiax.diagnose.pipeline inertiax.report.diagnosis inertiax.protocol.diagnosis_record",
    "calibrate": "inertiax.calibrate.pipeline inertiax.report.calibration",
    "check": "inertiax.plausibility inertiax.data.campaign",
    "compensate": "inertiax.exports.compensated_stream",
    "export": "inertiax.exports inertiax.calibration.calibration",
    "noise": "inertiax.allan inertiax.report.noise",
}


def commands(folder: Path) -> dict[str, list[str]]:
    """Arguments of each command on the recordings of `command_times`."""
    known = command_times.commands(folder)
    made = {
        "calibrate": known["calibrate Xsens"],
        "check": known["check Xsens"],
        "compensate": known["compensate"],
        "export": known["export"],
        "noise": known["noise"],
    }
    kept = {name: command[3:] for name, command in made.items()}  # after `python -m inertiax`
    kept["diagnose"] = ["diagnose", str(folder / "xsens"), "-o", str(folder / "out" / "diagnose")]
    return kept


def here(kind: str, name: str, arguments: list[str]) -> dict[str, float]:
    """One part of a command's cost, in this process."""
    import importlib

    if kind == "imports":
        from inertiax.cli import environment

        environment.prepare()
        for module in MODULES[name].split():
            importlib.import_module(module)
        return {"imports": time.process_time()}
    from inertiax.cli import environment, main

    environment.prepare()
    import jax

    spent: dict[str, float] = {}

    def listen(event: str, duration: float, **_: object) -> None:
        last = event.rsplit("/", 1)[-1]
        spent[last] = spent.get(last, 0.0) + duration

    jax.monitoring.register_event_duration_secs_listener(listen)
    watch = cProfile.Profile() if kind == "profile" else None
    if watch is not None:
        watch.enable()
    try:
        main(arguments)
    except SystemExit as ended:
        if ended.code:
            raise
    if watch is not None:
        watch.disable()
        return drawn(pstats.Stats(watch))
    used = resource.getrusage(resource.RUSAGE_SELF)
    unit = 1.0 if sys.platform == "darwin" else 1024.0  # of `ru_maxrss`, bytes
    return {
        "total": used.ru_utime + used.ru_stime,
        "tracing": sum(spent.get(e, 0.0) for e in TRACING),
        "compiling": sum(spent.get(e, 0.0) for e in COMPILING),
        "memory_mb": used.ru_maxrss * unit / 1e6,
    }


def drawn(found: pstats.Stats) -> dict[str, float]:
    """Share of a profiled run that was spent beneath the largest function of `report/`."""
    times = vars(found)["stats"]
    whole = max(row[3] for row in times.values())
    report = [row[3] for (file, _, _), row in times.items() if f"{os.sep}report{os.sep}" in file]
    return {"report_share": max(report, default=0.0) / whole}


def asked_for(kind: str, name: str, arguments: list[str], cache: Path) -> dict[str, float]:
    """`here` in a process of its own."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache), "MPLBACKEND": "Agg"}
    # As the command line sets it before NumPy is loaded, which this script loads sooner.
    environment["OPENBLAS_NUM_THREADS"] = "1"
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    command = [sys.executable, __file__, "--here", kind, name, *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{name}: {done.stderr.strip()[-500:]}")
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    if sys.argv[1:2] == ["--here"]:
        print(json.dumps(here(sys.argv[2], sys.argv[3], sys.argv[4:])))
        return
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=list(MODULES), default=list(MODULES))
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    results = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        command_times.prepare(folder)
        (folder / "out").mkdir()
        known = commands(folder)
        if set(asked.only) & {"compensate", "export"}:
            asked_for("run", "calibrate", known["calibrate"], folder / "cache")
        columns = ("total", "imports", "tracing", "compiling", "report", "the rest", "MB")
        print(f"{'':12}" + "".join(f"{c:>11}" for c in columns))
        for command in asked.only:
            arguments = known[command]
            asked_for("run", command, arguments, folder / "cache")
            found = asked_for("run", command, arguments, folder / "cache")
            found |= asked_for("imports", command, arguments, folder / "cache")
            found |= asked_for("profile", command, arguments, folder / "cache")
            running = found["total"] - found["imports"]
            report = found["report_share"] * running
            rest = running - found["tracing"] - found["compiling"] - report
            results[command] = {**found, "report": report, "rest": rest}
            row = (found["total"], found["imports"], found["tracing"], found["compiling"], report)
            print(
                f"{command:12}"
                + "".join(f"{x:11.2f}" for x in (*row, rest))
                + f"{found['memory_mb']:11.0f}",
                flush=True,
            )
    if asked.json is not None:
        asked.json.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
