"""Pages of the documentation: generated parts, commands that exist, links, length, words that are searched for."""

import importlib
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
import typer

from hard_limit import run_here
from inertiax.cli.app import app
from inertiax.data.settings import CampaignTable
from inertiax.effects import CATALOGUE


ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
READ = [*PAGES, ROOT / "README.md"]
COMMANDS = typer.main.get_command(app).commands
# Pages that are looked up and not read through, and measured figures.
LONG = ("reference", "benchmarks", "api")


@pytest.fixture(scope="module")
def hooks():
    """The module that MkDocs loads."""
    sys.path.insert(0, str(DOCS / "hooks"))
    try:
        return importlib.import_module("pages")
    finally:
        sys.path.pop(0)


@pytest.fixture(scope="module")
def generated(hooks) -> dict[str, str]:
    """What the site generates, by its name in the pages."""
    return {name: make() for name, make in hooks.GENERATORS.items()}


@pytest.mark.parametrize("page", sorted((DOCS / "tutorials").glob("*.md")), ids=lambda p: p.stem)
def test_a_tutorial_is_a_notebook_too(hooks, page):
    made = json.loads(hooks.notebooks.notebook(_text(page)))
    code = [c["source"] for c in made["cells"] if c["cell_type"] == "code"]
    assert (made["nbformat"], made["nbformat_minor"]) == (4, 5)
    assert len({c["id"] for c in made["cells"]}) == len(made["cells"])
    # Every Python block, file and command of the page, in this order and no other cell.
    shown = re.findall(r'^```(\w+)( title=".*?")?\n(.*?)^```', _text(page), re.M | re.S)
    runs = [(title, text) for kind, title, text in shown if kind in ("python", "console") or title]
    assert len(code) == len(runs)
    for source, (title, text) in zip(code, runs, strict=True):
        assert source.startswith(
            "%%writefile" if title else ("!" if text.startswith("$ ") else text[:9])
        )
        if not title and not source.startswith("!"):
            compile(source, page.name, "exec")


def test_formulas_become_mathml(hooks):
    html = '<p><span class="arithmatex">\\(\\sigma &lt; 1\\)</span></p>'
    drawn = hooks.on_page_content(html)
    assert 'alttext="\\sigma &lt; 1"' in drawn and "<mi>&#x003C3;</mi>" in drawn
    assert "arithmatex" not in drawn


def test_every_generated_part_is_on_one_page(generated):
    marks = [m for p in PAGES for m in re.findall(r"^<!-- generated: (.+) -->$", _text(p), re.M)]
    assert sorted(marks) == sorted(generated)


def test_the_command_line_reference_has_every_command_and_option(generated):
    text = generated["command line"]
    sections = dict(zip(*[iter(re.split(r"^## inertiax (\S+)$", text, flags=re.M)[1:])] * 2))
    assert list(sections) == list(COMMANDS)
    for name, command in COMMANDS.items():
        for parameter in command.params:
            if parameter.param_type_name == "option" and not parameter.hidden:
                assert max(parameter.opts, key=len) in sections[name], (name, parameter.name)


def test_bars_in_code_of_a_table_stay_bars(generated):
    assert "`TriadCalibration | None`" in generated["first layer"]
    assert "`--criterion D|A|I`" in generated["command line"]


def test_the_catalogue_page_has_every_effect_in_order(generated):
    rows = re.findall(
        r"^\| `(\w+)` \| (.*?) \| (?:both|acc|gyr)", generated["effect catalogue"], re.M
    )
    assert rows == [(e.name, e.title) for e in CATALOGUE]


def test_fields_have_their_units(generated):
    assert "| `reference_gyro` | `Float[AnyArray" in generated["first layer"]
    assert re.search(r"`temperature` .* °C, mean; 0 where no probe", generated["first layer"])
    assert "of the coefficients row by row, SI" in generated["result files"]
    # A field without its unit or meaning is of no use to who reads the page.
    assert not re.findall(
        r"^.* \|  \|$", generated["first layer"] + generated["result files"], re.M
    )


def test_every_key_of_a_campaign_is_on_its_page():
    text = _text(DOCS / "reference" / "campaign.md") + _text(DOCS / "reference" / "formats.md")
    for table in msgspec.structs.fields(CampaignTable):
        if table.name == "columns":  # names of columns are the file's own
            continue
        for key in msgspec.structs.fields(table.type):
            assert re.search(rf"`(?:\[{table.name}\] )?{key.name}`|^{key.name} = ", text, re.M), (
                key.name
            )


@pytest.mark.parametrize("page", READ, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_commands_on_a_page_exist(page):
    for line in _command_lines(_text(page)):
        words = shlex.split(line, comments=True)
        if len(words) < 2 or words[1].startswith("-") or words[1] == "…":
            continue
        assert words[1] in COMMANDS, line
        known = {o for p in COMMANDS[words[1]].params for o in (*p.opts, *p.secondary_opts)}
        for word in words[2:]:
            if re.match(r"--?[a-z]", word):
                assert word.partition("=")[0] in known | {"--help", "-h"}, line


def test_commands_are_found_in_text():
    # The rule above is empty where nothing is found.
    assert sum(len(_command_lines(_text(p))) for p in READ) > 100


@pytest.mark.parametrize("page", READ, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_lead_to_files(page):
    for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", _text(page)):
        if "://" not in link:
            assert (page.parent / link).exists(), link


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(DOCS).as_posix())
def test_a_page_is_as_long_as_its_question(page):
    if page.relative_to(DOCS).parts[0] not in LONG:
        limit = 1500 if page == DOCS / "explanation" / "diagnosis.md" else 2500
        assert len(_text(page).split()) <= limit


# Each block is pasted alone. `library.md`, the home page, `other-libraries.md`, `add-an-*.md` and the tutorials have
# tests of their own; the other pages need files that are not here.
RUNNING = (
    "how-to/apply-a-calibration.md",
    "how-to/calibrate-a-magnetometer.md",
    "how-to/diagnose.md",
    "how-to/gravity.md",
    "how-to/many-devices.md",
    "how-to/own-covariance.md",
    "explanation/gyros.md",
    "explanation/noise.md",
    "reference/exports.md",
)


@pytest.mark.slow
@pytest.mark.parametrize("wide", [False, True], ids=["32 bits", "64 bits"])
@pytest.mark.parametrize("page", RUNNING)
def test_blocks_of_other_pages_run_alone_in_both_precisions(page, wide):
    blocks = re.findall(r"^```python\n(.*?)^```", _text(DOCS / page), re.M | re.S)
    assert blocks
    said = "".join(run_here(block, seconds=300.0, wide=wide) for block in blocks)
    if page == "how-to/gravity.md":
        assert "9.808" in said  # gravity of the place, as its page says


# What people type, and the page that must be among the first three.
SEARCHED = {
    "calibrate six faces": "how-to/six-faces/",
    "six positions": "how-to/six-faces/",
    "allan deviation": "how-to/allan-noise/",
    "allan": "how-to/allan-noise/",
    "bias instability": "explanation/noise/",
    "noise density": "how-to/allan-noise/",
    "px4": "how-to/px4-ardupilot/",
    "ardupilot": "how-to/px4-ardupilot/",
    "turntable": "how-to/turntable/",
    "rate table": "how-to/turntable/",
    "raw counts": "how-to/raw-counts/",
    "openvins": "how-to/allan-noise/",
    "vins-mono": "how-to/allan-noise/",
    "kalibr": "how-to/allan-noise/",
    "ros": "how-to/ros-euroc/",
    "euroc": "how-to/ros-euroc/",
    "thermal calibration": "how-to/thermal-calibration/",
    "gravity": "how-to/gravity/",
    "only gyros": "how-to/only-gyros/",
    "unexplained": "how-to/unexplained/",
    "covariance": "how-to/own-covariance/",
    "too few positions": "how-to/it-fails/",
    "not converge": "how-to/it-fails/",
    "units": "how-to/units-and-axes/",
    "long logs": "how-to/long-logs/",
    "many devices": "how-to/many-devices/",
    "apply": "how-to/apply-a-calibration/",
    "microcontroller": "how-to/apply-a-calibration/",
    "hysteresis": "tutorials/concealed-effect/",
    "calibration.json": "reference/results/",
    "campaign.toml": "reference/campaign/",
    "certificate": "protocol/",
}


@pytest.fixture(scope="module")
def index(tmp_path_factory) -> list[dict[str, str]]:
    """The site's own search index, without the API's pages; of the site that `INERTIAX_SITE` names, where it does."""
    site = os.environ.get("INERTIAX_SITE")
    return [
        d
        for d in _index(Path(site) if site else _built(tmp_path_factory))
        if d["location"][:4] != "api/"
    ]


def _index(site: Path) -> list[dict[str, str]]:
    return json.loads((site / "search/search_index.json").read_text("utf-8"))["docs"]


def _built(tmp_path_factory) -> Path:
    pytest.importorskip("mkdocs")
    folder = tmp_path_factory.mktemp("site")
    settings = (ROOT / "mkdocs.yml").read_text("utf-8")
    # Signatures of the code are not what is asked for, and most of the building's time.
    settings = re.sub(r"^  - mkdocstrings:\n(?: {6}.*\n)+", "", settings, flags=re.M)
    settings = settings.replace("docs_dir: docs", f"docs_dir: {DOCS}")
    settings = settings.replace("hooks: [docs/", f"hooks: [{DOCS}/")
    (folder / "mkdocs.yml").write_text(settings, encoding="utf-8")
    command = [sys.executable, "-m", "mkdocs", "build", "-q", "-f", str(folder / "mkdocs.yml")]
    built = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert built.returncode == 0, built.stderr[-2000:]
    return folder / "site"


@pytest.mark.slow
def test_search_finds_what_people_type(index):
    wrong = {}
    for query, page in SEARCHED.items():
        found = _search(index, query)[:3]
        if page not in found:
            wrong[query] = found
    assert not wrong


def _search(index: list[dict[str, str]], query: str) -> list[str]:
    """Pages in the order in which the site's search shows them, nearly: all words; in titles, they count most."""
    words = query.lower().split()
    scores: dict[str, float] = {}
    for section in index:
        title, text = section["title"].lower(), re.sub(r"<[^>]*>", " ", section["text"]).lower()
        if not all(re.search(rf"\b{re.escape(w)}", f"{title} {text}") for w in words):
            continue
        page = section["location"].partition("#")[0]
        counts = [
            len(re.findall(rf"\b{re.escape(w)}", text)) / (20.0 + len(text.split())) for w in words
        ]
        named = [bool(re.search(rf"\b{re.escape(w)}", title)) for w in words]
        whole = 2.0 if page == section["location"] else 1.0
        score = sum(counts) + whole * sum(named) / (3.0 + len(title.split()))
        scores[page] = max(scores.get(page, 0.0), score)
    return sorted(scores, key=lambda page: -scores[page])


def _text(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def _command_lines(text: str) -> list[str]:
    """Commands of this program in code: lines of blocks, and what stands between backticks."""
    blocks = "".join(re.findall(r"^ *```(?:sh|console|text)?\n(.*?)^ *```", text, re.M | re.S))
    lines = re.findall(r"^(?:\$ )?(inertiax [a-z].*)$", blocks, flags=re.M)
    return [*lines, *(" ".join(c.split()) for c in re.findall(r"`(inertiax [a-z][^`]*)`", text))]
