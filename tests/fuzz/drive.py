"""Coverage-guided fuzzing of readers with atheris; from `tests/`: `python -m fuzz.drive csv ulog --runs 100000`.

Needs `pip install inertiax[fuzz,test]`. Stops at the first crash, hang (10 s) or memory above 2 GB, and leaves
the bytes in `--findings`; a finding that is fixed goes into `corpus/`.
"""

import argparse
import os
import random
import re
import sys
import tempfile
from pathlib import Path

import atheris


INSTRUMENTED = [
    "inertiax.data.formats",
    "inertiax.exports",
    "inertiax.data.campaign",
    "inertiax.data.settings",
    "inertiax.calibration",
]
INSTRUMENTED += [
    "inertiax.calibration.fitted_effects",
    "inertiax.data.recording",
    "inertiax.simulate",
    "inertiax.exports.compensated_recording",
]
INSTRUMENTED += [
    "inertiax.data.model_columns",
    "pyulog",
    "rosbags",
    "tomllib",
    "yaml",
    "ruamel",
]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="+")
    parser.add_argument("--runs", type=int, default=10000)
    parser.add_argument("--seconds", type=int, default=0, help="at most; 0: no limit")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--longest", type=int, default=0, help="bytes; 0: twice the seeds")
    parser.add_argument("--findings", type=Path, default=Path(tempfile.gettempdir()) / "findings")
    said = parser.parse_args()
    with atheris.instrument_imports(include=INSTRUMENTED, enable_loader_override=False):
        import fuzz.targets  # noqa: F401
    for name in said.targets:
        child = (
            os.fork()
        )  # libFuzzer ends its process; importing takes longer than fuzzing a little
        if not child:
            _fuzz(name, said)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        print(f"{name}: exit status {status}", file=sys.stderr, flush=True)


def _fuzz(name: str, said: argparse.Namespace) -> None:
    import jax

    from fuzz.mutate import change_of, of_bytes
    from fuzz.targets import attempt, prepare, TARGETS

    jax.config.update("jax_enable_x64", True)
    target = TARGETS[name]
    home = Path(tempfile.mkdtemp(prefix="inertiax-fuzz-", dir=_memory()))
    folder, corpus = home / "files", home / "corpus"
    for new in (folder, corpus, said.findings):
        new.mkdir(parents=True, exist_ok=True)
    prepare(target, folder)
    seeds = target.seeds()
    for number, seed in enumerate(seeds):
        (corpus / f"seed-{number}").write_bytes(seed)
        refused = attempt(target, folder, seed)
        if refused:
            print(f"seed {number} is refused: {refused}", file=sys.stderr)
    for known in sorted((Path(__file__).parent / "corpus" / name).glob("*")):
        (corpus / known.name).write_bytes(known.read_bytes())
    (home / "words").write_text(_words(seeds))
    longest = said.longest or 2 * max(map(len, seeds))
    settings = [
        f"-runs={said.runs}",
        f"-max_total_time={said.seconds}",
        f"-seed={said.seed}",
        f"-max_len={longest}",
        f"-dict={home / 'words'}",
        f"-artifact_prefix={said.findings}/{name}-",
        "-timeout=10",
        "-rss_limit_mb=2048",
        "-len_control=0",
        "-print_final_stats=1",
        "-verbosity=1",
    ]
    change = change_of(target.file)

    def mutate(data: bytes, most: int, seed: int) -> bytes:
        """Half of the changes are libFuzzer's, which knows what reaches new code."""
        chance = random.Random(seed)
        if change is of_bytes or chance.random() < 0.5:
            return atheris.Mutate(data, most)
        return change(data, chance)[:most]

    def attempt_one(data: bytes) -> None:
        attempt(target, folder, data)

    atheris.Setup([sys.argv[0], *settings, str(corpus)], attempt_one, custom_mutator=mutate)
    atheris.Fuzz()


def _memory() -> str | None:
    """Files in memory where there is such a place: a disk is slower than most readers."""
    return "/dev/shm" if Path("/dev/shm").is_dir() else None


def _words(seeds: list[bytes]) -> str:
    """A libFuzzer dictionary of the words in the seeds, and values that break parsers."""
    words = {w for s in seeds for w in re.findall(rb"[A-Za-z_./\[\]]{3,24}", s)}
    words |= {b"NaN", b"nan", b"inf", b"-1", b"1e999", b"1e308", b"99999999999999999999", b"null"}
    words |= {
        b"[[[[[[[[",
        b"{}",
        b"\xff\xff\xff\xff",
        b"\x00\x00\x00\x80",
        b"\xff\xff\xff\x7f",
        b'"\\u0000"',
    }
    quoted = ["".join(f"\\x{b:02x}" for b in w) for w in sorted(words)[:400]]
    return "".join(f'"{w}"\n' for w in quoted)


if __name__ == "__main__":
    main()
