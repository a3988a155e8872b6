"""Draws a case: plan, device, omission and its size."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import linear
import menu
import numpy as np
import plans
import rig
import textbook
import world
from table import Plan
from truth import Effect, Scene


Z_VALUES = (3, 5, 6, 8, 10, 15, 30)
ALIAS_R2 = 0.95


@dataclass
class Drawn:
    """An effect with its size and what this plan shows of it."""

    effect: Effect
    size: float
    signal: np.ndarray
    z: float
    accepted: dict[str, float]
    channels_accepted: list[int]
    textbook_r2: float


@dataclass
class Case:
    """Everything about one case, the concealed part included."""

    kind: str
    plan: Plan
    grade_name: str
    gravity: float
    latitude: float
    strong: bool
    heat: world.Heat
    level: dict[str, float]  # of each kind of noise and of the rig's errors, in the grade's
    scenes: dict[str, Scene]
    noise: dict[str, world.Noise]
    problems: dict[str, linear.Problem]
    views: dict[str, textbook.View]
    drawn: list[Drawn] = field(default_factory=list)
    output: dict[str, np.ndarray] = field(default_factory=dict)
    disturbance: dict[str, np.ndarray] = field(default_factory=dict)  # output less nominal
    reference: dict[str, np.ndarray] = field(default_factory=dict)
    verdict: list[str] = field(default_factory=list)

    @property
    def grade(self) -> world.Grade:
        return world.GRADES[self.grade_name]


class Unsuitable(Exception):
    """This draw shows nothing fair; draw again."""


def stage(kind: str, make: Callable[..., Plan], settings: dict, rng) -> Case:
    """A plan carried out with a device that has no omission yet."""
    plan = make(rng, **settings)
    grade_name = str(rng.choice(list(world.GRADES)))
    grade = world.GRADES[grade_name]
    latitude = float(rng.uniform(35, 60))
    gravity = 9.780327 * (1 + 0.0053024 * np.sin(np.deg2rad(latitude)) ** 2) - float(
        rng.uniform(0, 2e-3)
    )
    heat = world.heat(plan, grade, rng, case_tau=float(rng.uniform(60, 200)))
    strong = bool(rng.random() < 0.4)
    low, high = (1.0, 2.0) if strong else (0.3, 1.0)
    level = {k: float(rng.uniform(low, high)) for k in ("flicker", "walk", "dwell", "session")}
    level["rig"] = float(rng.uniform(0.5, 1.0))
    case = Case(kind, plan, grade_name, gravity, latitude, strong, heat, level, {}, {}, {}, {})
    return equip(case, rng)


def equip(case: Case, rng) -> Case:
    """Device, noise and everything that follows from the plan."""
    plan, grade, heat, gravity = case.plan, case.grade, case.heat, case.gravity
    earth = world.earth(plan, case.latitude)
    fs = 1 / float(np.median(np.diff(plan.time)))
    for triad in plan.triads:
        ideal = gravity * plan.up if triad == "accel" else plan.rate + earth
        degree = int(plan.model["temperature_degree"])
        kind_ = plan.model[f"{triad}_estimator"]
        device = world.sensor(
            grade, triad, degree, heat.case.min(), heat.case.max(), kind_ == "invariant", rng
        )  # fmt: skip
        if kind_ == "static":
            device.matrix *= (
                0.02  # a static model has no matrix, so the device may have next to none
            )
        case.scenes[triad] = Scene(
            plan, triad, case.grade_name, heat, device, ideal, plan.up, gravity, earth
        )  # fmt: skip
        # A stream of its own: how unlike the channels are changes nothing else of a case.
        noise = world.Noise.of(grade, triad, fs, case.level, rng.spawn(1)[0])
        case.noise[triad] = noise
        slope = device.slope(heat.probe, ideal)
        case.problems[triad] = linear.problem(
            plan, triad, ideal, plan.up, heat.probe, noise, slope, grade.temperature
        )  # fmt: skip
        case.views[triad] = textbook.View(
            plan, triad, heat.probe, ideal, plan.up, earth, gravity, slope,
            lambda t, device=device, ideal=ideal: device.output(t, ideal),
        )  # fmt: skip
    return case


UNIT_SCATTER = 0.15  # of the logarithm of a noise's standard deviation, between units of one type


def sibling(case: Case, rng) -> Case:
    """Another unit of the same type on the same station and plan, with nothing omitted, recorded.

    Its parameters are its own, and each kind of its noise differs a little; the rig's errors are as large.
    """
    heat = world.heat(case.plan, case.grade, rng, case_tau=float(rng.uniform(60, 200)))
    level = {
        k: v if k == "rig" else v * float(np.exp(UNIT_SCATTER * rng.standard_normal()))
        for k, v in case.level.items()
    }
    made = Case(
        "sibling", case.plan, case.grade_name, case.gravity, case.latitude, case.strong, heat, level,
        {}, {}, {}, {}, verdict=["consistent"],
    )  # fmt: skip
    equip(made, rng)
    record(made, rng)
    return made


def solve_size(case: Case, effect: Effect, target: float, given: list[np.ndarray]) -> float:
    """Size at which the visible part is `target` standard deviations; `Unsuitable` above the limit."""
    z_at = lambda a: visible_z(case, effect, a, given)
    if effect.linear:
        unit = z_at(1.0)
        if unit <= 0 or target / unit > 3 * effect.limit:
            raise Unsuitable
        return target / unit
    low, high = effect.detail.get("low", effect.limit * 1e-5), effect.limit
    if z_at(high) < target or z_at(low) > target:
        raise Unsuitable
    for _ in range(30):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if z_at(middle) < target else (low, middle)
    return float(np.sqrt(low * high))


def visible_z(case: Case, effect: Effect, size: float, given: list[np.ndarray]) -> float:
    v = case.problems[effect.triad].visible(effect.signal(size))
    if given:
        q = linear.span(np.stack(given, -1))
        v = v - q @ (q.T @ v)
    return float(np.linalg.norm(v))


def recognise(case: Case, effect: Effect, seen: np.ndarray, given=None) -> dict[str, float]:
    """R² of the visible signature in each catalogued name's best textbook form."""
    problem, view = case.problems[effect.triad], case.views[effect.triad]
    names, reduced = [], []
    for name, candidate in textbook.forms(view):
        signals = candidate(effect.channels)
        names.append(name)
        reduced.append(np.stack([problem.reduce(x) for x in np.moveaxis(signals, -1, 0)], -1))
    edges = np.cumsum([r.shape[1] for r in reduced])[:-1]
    columns = problem.project(problem.whiten(np.concatenate(reduced, -1)))
    best: dict[str, float] = {}
    for name, part in zip(names, np.split(columns, edges, axis=1), strict=True):
        best[name] = max(best.get(name, 0.0), linear.share(seen, part, given))
    return best


def located(case: Case, effect: Effect, signal: np.ndarray, seen: np.ndarray) -> list[int]:
    """Channels that this plan cannot tell from the true one."""
    if len(effect.channels) != 1:
        return list(effect.channels)
    problem = case.problems[effect.triad]
    out = []
    for c in range(3):
        moved = np.zeros_like(signal)
        moved[:, c] = signal[:, effect.channels[0]]
        if linear.share(seen, problem.visible(moved)[:, None]) >= ALIAS_R2:
            out.append(c)
    return sorted({*out, *effect.channels})


def add(case: Case, effect: Effect, size: float, others: list[np.ndarray]) -> Drawn:
    """Measure what this plan shows of the effect at that size, beside `others` (visible)."""
    signal = effect.signal(size)
    seen = case.problems[effect.triad].visible(signal)
    given = np.stack(others, -1) if others else None
    best = recognise(case, effect, seen, given)
    accepted = {k: round(v, 4) for k, v in best.items() if v >= ALIAS_R2}
    made = Drawn(
        effect, size, signal, visible_z(case, effect, size, others), accepted,
        located(case, effect, signal, seen), round(best.get(effect.name, 0.0), 4),
    )  # fmt: skip
    if effect.name.startswith("x_"):
        made.accepted = {}
        made.textbook_r2 = round(max(best.values()), 4)
    else:
        made.accepted.setdefault(effect.name, made.textbook_r2)
    return made


def _pick(rows, rng):
    """An effect drawn evenly by name and triad, then a plan that shows it."""
    names = sorted({(e.__name__, triad) for _, _, triad, effects in rows for e in effects})
    name, triad = names[rng.integers(len(names))]
    found = [(m, s, e) for m, s, t, es in rows for e in es if t == triad and e.__name__ == name]
    make, settings, effect = found[rng.integers(len(found))]
    if make is plans.pose:
        settings = {"triad": str(rng.choice([triad, triad, "both"])), **settings}
    return make, settings, triad, effect


def _sized(case, effect, z_values, others, rng) -> Drawn:
    sign = 1.0 if not effect.linear or effect.fixed else float(rng.choice([-1, 1]))
    if effect.fixed is not None:
        return add(case, effect, effect.fixed, others)
    size = solve_size(case, effect, float(rng.choice(z_values)), others)
    return add(case, effect, sign * size, others)


def _fair(drawn: Drawn):
    if drawn.textbook_r2 < 0.9 or not 2.5 <= drawn.z <= 2000 or len(drawn.accepted) > 5:
        raise Unsuitable


def single(rng, sizes=Z_VALUES) -> Case:
    make, settings, triad, of = _pick(menu.MENU, rng)
    case = stage("single", make, settings, rng)
    case.drawn = [_sized(case, of(case.scenes[triad], rng), sizes, [], rng)]
    _fair(case.drawn[0])
    case.verdict = ["missing-physics"]
    return case


def double(rng) -> Case:
    """Two effects of one plan, each sized by what it adds to the other."""
    make, settings, triad, of = _pick(menu.MENU, rng)
    case = stage("double", make, settings, rng)
    choices = [
        (t, e) for m, _, t, es in menu.MENU for e in es
        if m is make and t in case.scenes and e is not rig.earth_rate and e is not of
    ]  # fmt: skip
    triad2, of2 = choices[rng.integers(len(choices))]
    pair = [of(case.scenes[triad], rng), of2(case.scenes[triad2], rng)]
    trial = [e.fixed or (1.0 if e.linear else e.limit / 5) for e in pair]
    seen = [case.problems[e.triad].visible(e.signal(a)) for e, a in zip(pair, trial, strict=True)]
    same = triad == triad2
    if any(np.linalg.norm(s) == 0 for s in seen) or (
        same and linear.share(seen[0], seen[1][:, None]) > 0.5
    ):
        raise Unsuitable
    for k in (0, 1):
        others = [seen[1 - k]] if same else []
        case.drawn.append(_sized(case, pair[k], (6, 8, 10, 15, 30), others, rng))
        _fair(case.drawn[k])
    if any(set(d.accepted) & set(case.drawn[0].accepted) for d in case.drawn[1:]):
        raise Unsuitable
    case.verdict = ["missing-physics"]
    return case


def outside(rng) -> Case:
    make, settings, triad, of = _pick(menu.OPEN, rng)
    case = stage("open", make, settings, rng)
    drawn = _sized(case, of(case.scenes[triad], rng), (10, 15, 30), [], rng)
    if drawn.textbook_r2 > 0.7 or drawn.z * np.sqrt(1 - drawn.textbook_r2) < 6:
        raise Unsuitable
    case.drawn, case.verdict = [drawn], ["unexplained"]
    return case


def aliased(rng, absorbed: bool) -> Case:
    """Plans that cannot name the effect: the answer is the set, or nothing at all."""
    make, settings, triad, of = _pick(menu.ALIASED, rng)
    case = stage("aliased", make, settings, rng)
    effect = of(case.scenes[triad], rng)
    typical = effect.fixed or effect.limit * float(rng.uniform(0.3, 1.0))
    if absorbed != (visible_z(case, effect, typical, []) < 1.0):
        raise Unsuitable
    if absorbed:
        case.drawn, case.verdict = [add(case, effect, typical, [])], ["consistent"]
        return case
    drawn = _sized(case, effect, (8, 10, 15, 30), [], rng)
    if len(drawn.accepted) < 2:
        raise Unsuitable
    case.drawn, case.verdict = [drawn], ["missing-physics"]
    return case


def null(rng) -> Case:
    make, settings, triad, _ = _pick(menu.MENU, rng)
    del triad
    if settings.get("degree") == 0:
        raise Unsuitable  # a model without temperature over 60 °C is no null
    case = stage("null", make, settings, rng)
    case.verdict = ["consistent"]
    return case


def record(case: Case, rng):
    """Run the plan: outputs with effects, noise, rig errors and converters; references as planned."""
    case.reference["accel"] = np.round(case.gravity * case.plan.up, 12)
    turned = case.plan.rate + world.earth(case.plan, case.latitude)
    case.reference["gyro"] = np.round(turned, 12)  # what the table reports, gyros or not
    for triad in case.plan.triads:
        s, noise = case.scenes[triad], case.noise[triad]
        turn, pace = world.rig_errors(case.plan, noise, rng)
        felt = s.ideal + np.cross(s.ideal, turn)
        if triad == "gyro":
            felt = felt + pace[:, None] * case.plan.rate
        clean = s.sensor.output(case.heat.case, felt)
        reference = s.ideal.copy()
        for d in case.drawn:
            if d.effect.triad != triad:
                continue
            if d.effect.name == "earth_rate":
                reference -= d.signal
            else:
                clean = clean + d.signal
        noisy = clean + world.sensor_noise(case.plan, noise, rng)
        case.output[triad] = np.round(world.quantise(noisy, noise.step), 12)
        case.reference[triad] = np.round(reference, 12)
        nominal = s.sensor.output(case.heat.probe, s.ideal)
        case.disturbance[triad] = case.output[triad] - nominal + (s.ideal - reference)


def case(kind: str, rng: np.random.Generator, sizes: Sequence[float] = Z_VALUES) -> Case:
    """Draw until the case is fair, then run it; `sizes` are the z of single effects."""
    absorbed = bool(rng.random() < 0.5)
    makers = dict(null=null, double=double, open=outside)
    makers["single"] = lambda again: single(again, sizes)
    makers["aliased"] = lambda again: aliased(again, absorbed)
    for _ in range(80):
        try:
            made = makers[kind](rng)
        except Unsuitable:
            continue
        record(made, rng)
        return made
    raise RuntimeError(f"`case({kind!r})`: 80 draws and none was fair")


def oracle(case: Case, triad: str) -> dict:
    """What the fit with the true effects in the model leaves: chi² per dof, rms of blocks and dwells."""
    p = case.problems[triad]
    seen = [p.visible(d.signal) for d in case.drawn if d.effect.triad == triad]
    y = p.visible(case.disturbance[triad])
    dof = len(y) - p.base.shape[1]
    out = {"blocks": len(p.blocks.first), "dwells": len(np.unique(p.blocks.dwell)), "dof": dof}
    out["chi2_baseline"] = float(y @ y / dof)
    out["rms_baseline"], out["rms_baseline_dwell"] = _rms(p, y)
    live = [v for v in seen if np.linalg.norm(v) > 1e-6]
    if live:
        a = np.stack(live, -1)
        fitted, *_ = np.linalg.lstsq(a, y, rcond=None)
        out["fitted"] = [float(x) for x in fitted]  # share of the true size; 1 ± 1/z
        y = y - a @ fitted
        dof -= len(live)
    out["chi2"] = float(y @ y / dof)
    out["rms"], out["rms_dwell"] = _rms(p, y)
    return out


def _rms(p: linear.Problem, whitened: np.ndarray) -> tuple[float, float]:
    """rms over blocks and over dwell means, in the triad's unit; a long rest counts by the minute."""
    r = p.chol @ whitened
    parts = r.reshape(-1, len(p.blocks.first))
    minute = (p.blocks.time // 60).astype(int) if p.plan.name == "pose" else 0 * p.blocks.dwell
    _, index = np.unique(p.blocks.dwell * 100000 + minute, return_inverse=True)
    weight = np.bincount(index)
    means = np.stack([np.bincount(index, x) / weight for x in parts])
    return float(np.sqrt(np.mean(r**2))), float(np.sqrt(np.mean(means**2)))


def answer(case: Case) -> dict:
    """The sealed answer of one case."""
    return {
        "kind": case.kind, "verdict": case.verdict, "plan": case.plan.name, "options": case.plan.options,
        "grade": case.grade_name, "strong": case.strong, "rows": len(case.plan.time),
        "effects": [_effect_answer(case, d) for d in case.drawn],
        "oracle": {t: oracle(case, t) for t in case.plan.triads},
    }  # fmt: skip


def _recorded(plan: Plan, span: list | None) -> list | None:
    """The part of the intervals during which there was a log."""
    if span is None:
        return None
    rows = [plan.time[plan.session == s][[0, -1]] for s in np.unique(plan.session)]
    pairs = [(max(a, float(s)), min(b, float(e))) for a, b in span for s, e in rows]
    return [[a, b] for a, b in pairs if b > a]


def _effect_answer(case: Case, d: Drawn) -> dict:
    e = d.effect
    name = lambda c: f"{e.triad}_{'xyz'[c]}"
    parameters = {}
    for key, value in e.parameters.items():
        number, unit = (d.size, e.unit) if value == "size" else value
        parameters[key] = {"value": number, "unit": unit}
    if e.coefficient:
        parameters["coefficient"] = {"value": d.size, "unit": e.coefficient}
    for k, (share, unit) in enumerate(e.vector):
        parameters[f"coefficient[{k}]"] = {"value": d.size * share, "unit": unit}
    return {
        "name": e.name, "channels": [name(c) for c in e.channels],
        "channels_accepted": [name(c) for c in d.channels_accepted],
        "accepted": sorted(d.accepted), "alias_r2": {k: v for k, v in d.accepted.items() if k != e.name},
        "textbook_r2": d.textbook_r2, "z": round(d.z, 2), "size": d.size, "unit": e.unit,
        "detail": e.detail, "parameters": parameters, "span": _recorded(case.plan, e.span),
        "span_otherwise": _recorded(case.plan, e.span_otherwise),
    }  # fmt: skip
