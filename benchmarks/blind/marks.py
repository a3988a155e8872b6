"""Marks of one case: what the diagnosis said against what was true."""

from dataclasses import dataclass, field


@dataclass
class Mark:
    """One case's outcome; `None` where a question does not arise."""

    case: str
    kind: str
    plan: str
    z: float | None
    true: list[str]
    said: list[str]
    verdict: str
    right_verdict: bool = False
    detected: bool | None = None
    first_in_class: bool | None = None
    true_in_set: bool | None = None
    set_size: int | None = None
    both_found: bool | None = None
    misnamed: bool | None = None
    channel: bool | None = None
    iou: float | None = None
    covered: list[bool] = field(default_factory=list)
    held_out_ratio: float | None = None
    improvement_ratio: float | None = None
    seconds: float | None = None
    expected: str = ""


def name_set(effect: dict) -> list[str]:
    """The answer about one effect: its name and the names that the data cannot tell from it."""
    return list(dict.fromkeys([effect["name"], *effect.get("alternatives", [])]))


def union_length(intervals) -> float:
    """Total length of a union of [start, end]."""
    total, end = 0.0, float("-inf")
    for a, b in sorted(map(tuple, intervals)):
        total += max(b - max(a, end), 0.0)
        end = max(end, b)
    return total


def overlap(said, true) -> float:
    """Intersection over union of two unions of intervals."""
    whole = union_length([*said, *true])
    common = union_length(said) + union_length(true) - whole
    return common / whole if whole > 0 else 0.0


def _located(effect: dict, truth: dict) -> bool:
    """Right channels: for one channel exactly one that is accepted, for several none outside them."""
    said = set(effect.get("channels", []))
    if not said:
        return False
    inside = said <= set(truth["channels_accepted"])
    return inside and (len(said) == 1 or len(truth["channels"]) > 1)


def _spans(diagnosis: dict, truth: dict) -> list:
    where = diagnosis.get("where", [])
    on = [w for w in where if w.get("channel") in truth["channels_accepted"]]
    return [(w["start"], w["end"]) for w in on if w.get("start") is not None]


def _unit(parameter: dict) -> str:
    """The unit; a quantity over itself is 1."""
    unit = parameter.get("unit") or "1"
    above, _, below = unit.partition(")/(")
    return "1" if below and above.lstrip("(") == below.rstrip(")") else unit


def _coverage(effect: dict, truth: dict) -> list[bool]:
    out = []
    for key, true in truth["parameters"].items():
        said = effect.get("parameters", {}).get(key)
        if said is None or said.get("std") is None or _unit(said) != _unit(true):
            continue
        out.append(bool(abs(said["value"] - true["value"]) <= 1.96 * said["std"]))
    return out


def _ratios(mark: Mark, diagnosis: dict, oracle: dict):
    fit = diagnosis.get("fit", {})
    augmented, baseline = fit.get("augmented", {}), fit.get("baseline", {})
    if augmented.get("held_out_rms") and oracle["rms_dwell"] > 0:
        mark.held_out_ratio = augmented["held_out_rms"] / oracle["rms_dwell"]
        if baseline.get("held_out_rms"):
            said = augmented["held_out_rms"] / baseline["held_out_rms"]
            mark.improvement_ratio = said / (oracle["rms_dwell"] / oracle["rms_baseline_dwell"])


def _same(effect: dict, truth: dict) -> bool:
    """The true name on the true channels."""
    return effect["name"] == truth["name"] and effect.get("channels") == truth["channels"]


def _both(effects: list[dict], truths: list[dict]) -> bool:
    """Two different named effects for the two true ones."""
    fits = lambda e, t: (
        e["name"] in t["accepted"]
        and bool(set(e.get("channels", [])) & set(t["channels_accepted"]))
    )
    a, b = truths
    return any(
        fits(x, a) and fits(y, b)
        for i, x in enumerate(effects)
        for j, y in enumerate(effects)
        if i != j
    )


def mark(answer: dict, diagnosis: dict | None, seconds: float | None) -> Mark:
    """Marks of one case; a run without a diagnosis is wrong in everything it was asked."""
    truths = answer["effects"]
    z = min(t["z"] for t in truths) if truths else None
    failed = diagnosis is None
    diagnosis = diagnosis or {"verdict": "failed", "effects": []}
    effects = diagnosis.get("effects", [])
    out = Mark(
        answer["case"], answer["kind"], answer["plan"], z, [t["name"] for t in truths],
        [e["name"] for e in effects], diagnosis["verdict"], seconds=seconds,
        expected=answer["verdict"][0],
    )  # fmt: skip
    out.right_verdict = diagnosis["verdict"] in answer["verdict"]
    if not truths:
        return out
    out.detected = diagnosis["verdict"] in ("missing-physics", "unexplained")
    if answer["kind"] == "open":
        out.misnamed = diagnosis["verdict"] == "missing-physics"
        return out
    if answer["verdict"] == ["consistent"]:
        return out
    if answer["kind"] == "double":
        out.both_found = _both(effects, truths)
        out.covered = [
            c for t in truths for e in effects if _same(e, t) for c in _coverage(e, t)
        ]  # fmt: skip
        return out
    _mark_first(out, effects[0] if effects else None, truths[0], diagnosis)
    if effects and not failed and out.first_in_class:
        triad = truths[0]["channels"][0].split("_")[0]
        _ratios(out, diagnosis, answer["oracle"][triad])
    return out


def _mark_first(out: Mark, first: dict | None, truth: dict, diagnosis: dict):
    """Naming, channel, span and interval of a single effect."""
    out.first_in_class = first is not None and first["name"] in truth["accepted"]
    out.true_in_set = first is not None and truth["name"] in name_set(first)
    if first is None:
        return
    out.set_size = len(name_set(first))
    out.channel = _located(first, truth)
    if truth["span"]:
        said = _spans(diagnosis, truth)
        either = [s for s in (truth["span"], truth.get("span_otherwise")) if s]
        out.iou = max(overlap(said, s) for s in either)
    if first["name"] == truth["name"]:
        out.covered = _coverage(first, truth)
