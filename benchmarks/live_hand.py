"""How soon `live` reaches a target by hand, against the best fixed plan, and whether what it says then is true.

Devices, noise and persons are made here by NumPy alone; no function of the package makes a number that it is judged by.
Of each device nothing is known beforehand: biases of 30 mg, scale factors of 1 %, misalignments of 0.5° (1 sigma), the
noise of a rest's mean and the scatter from rest to rest each log-normal about 0.25 mg (a factor of 1.8, 1 sigma). A
person turns the device to within 10° (mean) of what is said, now and then (3 %) to where it was not told, and in 5 % of
the rests taps or holds it: such a rest is refused, and counts as one that was made.

Each session is followed until `live` says that the target is reached. The fixed plans are lists of directions made
beforehand: the cube's 26 in order and shuffled, 18 (faces and edges), 20 (edges and corners), six faces and an edge in
turn (near the optimum for this target, `live_bound.py`), 24 and 48 spread over the sphere, all followed by the same
person. A plan's length is the number of rests after which 95 % of the devices have
reached the target: by the truth (all errors within their limits), or by the same statement as `live`'s (every device is
known to be within them with 95 %, quiet or noisy). The best plan is the shortest.

    python benchmarks/live_hand.py [--sessions 200] [--first 0] [--rows 6]

`--rows` sessions are made sample by sample (100 Hz, tremor while turning, taps), so that rests have to be found.
"""

import argparse
import itertools
import time

import numpy as np

from inertiax.data.recording import Campaign, Recording, Rig, Site
from inertiax.live.estimate import Estimate, estimate
from inertiax.live.rest_ledger import Rest
from inertiax.live.session import Session
from inertiax.live.target import parse_target


GRAVITY = 9.80665
MG = 1e-3 * GRAVITY
TARGET = parse_target("accel.bias=0.5 mg, accel.scale=600 ppm")
NOISE, SCATTER, SPREAD = 0.25 * MG, 0.25 * MG, 0.6
OFF, ELSEWHERE, REFUSED = np.radians(10.0), 0.03, 0.05
LONGEST = 400  # rests
CAMPAIGN = Campaign((), Site(GRAVITY), Rig())


class Device:
    """Unknown errors and noise."""

    def __init__(self, rng: np.random.Generator):
        self.bias = 30.0 * MG * rng.standard_normal(3)
        whole = np.eye(3) + np.diag(0.01 * rng.standard_normal(3))
        whole += np.radians(0.5) * rng.standard_normal((3, 3)) * (1 - np.eye(3))
        # Only |f| is known: the matrix is told up to a rotation, M = L Q with L lower triangular.
        q, r = np.linalg.qr(whole.T)
        sign = np.sign(np.diag(r))
        self.lower = r.T * sign
        self.truth = np.concatenate([self.bias, (self.lower - np.eye(3))[np.tril_indices(3)]])
        self.noise = NOISE * np.exp(SPREAD * rng.standard_normal())
        self.scatter = SCATTER * np.exp(SPREAD * rng.standard_normal())

    def mean(self, rng: np.random.Generator, up: np.ndarray) -> np.ndarray:
        """Mean of a rest."""
        error = np.hypot(self.noise, self.scatter) * rng.standard_normal(3)
        return self.lower @ (GRAVITY * up) + self.bias + error

    def errors(self, found: Estimate) -> np.ndarray:
        """Errors of the nine parameters, SI."""
        order = [f"accel.bias[{i}]" for i in range(3)]
        order += [f"accel.matrix[{i},{j}]" for i, j in zip(*np.tril_indices(3))]
        values = found.parameters()
        return np.array([values[n]["value"] for n in order], float) - self.truth


def unit(rng: np.random.Generator) -> np.ndarray:
    """A random direction."""
    x = rng.standard_normal(3)
    return x / np.linalg.norm(x)


def held(rng: np.random.Generator, told: np.ndarray) -> np.ndarray:
    """Where a person holds what was told."""
    if rng.random() < ELSEWHERE:
        return unit(rng)
    across = np.cross(told, unit(rng))
    across /= np.linalg.norm(across)
    angle = OFF * np.sqrt(2.0 / np.pi) * np.hypot(*rng.standard_normal(2))  # of mean OFF
    return np.cos(angle) * told + np.sin(angle) * across


def rest_of(rng: np.random.Generator, device: Device, up: np.ndarray, number: int) -> Rest:
    """A rest as the ledger would have it; its noise is known as well as 16 blocks tell."""
    mean = device.mean(rng, up)
    said = device.noise**2 * rng.chisquare(36) / 36
    return Rest(number, 1, 0, 1, (0.0, 1.0), accel=mean, accel_covariance=said * np.eye(3))


def limits() -> np.ndarray:
    """Of the nine parameters."""
    scale = 600e-6
    free = np.inf
    return np.array([0.5 * MG] * 3 + [scale, free, scale, free, free, scale])


def adaptive(rng: np.random.Generator, device: Device) -> tuple[int, Estimate, bool]:
    """Rests made until `live` stops, what it says then, and whether it says that the target is reached."""
    rests: list[Rest] = []
    found, told, made = None, np.array([0.0, 0.0, 1.0]), 0
    while made < LONGEST:
        made += 1
        up = held(rng, told)
        if rng.random() < REFUSED:
            continue
        rests.append(rest_of(rng, device, up, len(rests) + 1))
        found = estimate(rests, CAMPAIGN, TARGET, found)
        if found.reached:
            return made, found, True
        told = np.array(found.next_position().up)
        told /= np.linalg.norm(told)
    return made, found, False


def least_squares(outputs: np.ndarray) -> np.ndarray:
    """Bias and lower triangular matrix by gravity's magnitude, all rests alike: what a fixed plan is worth."""
    rows, columns = np.tril_indices(3)
    vector = np.zeros(9)
    for _ in range(12):
        matrix = np.eye(3)
        matrix[rows, columns] += vector[3:]
        inverse = np.linalg.inv(matrix)
        force = (outputs - vector[:3]) @ inverse.T
        size = np.linalg.norm(force, axis=1)
        w = (force / size[:, None]) @ inverse
        jacobian = np.hstack([-w, -w[:, rows] * force[:, columns]])
        step = np.linalg.lstsq(jacobian, size - GRAVITY, rcond=None)[0]
        vector = vector - step
        if not np.all(np.isfinite(vector)) or np.abs(vector).max() > 100.0:
            return np.full(9, np.inf)
    return vector


LENGTHS = np.array(
    [9, 12, 15, 18, 20, 22, 24, 26, 28, 30, 32, 34, 36, 39, 42, 46, 50, 54, 59, 65, 71, 78, 92]
    + [110, 130, 156, 190, 230, 280]
)


def plans(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Directions of each plan, one round."""
    cube = np.array([v for v in itertools.product((-1, 0, 1), repeat=3) if any(v)], float)
    count = np.abs(cube).sum(axis=1)
    norm = lambda x: x / np.linalg.norm(x, axis=1, keepdims=True)
    in_order = np.concatenate([cube[count == k] for k in (1, 2, 3)])
    made = {
        "26 of the cube": norm(in_order),
        "26 of the cube, shuffled": norm(rng.permutation(cube)),
        "faces and edges, 18": norm(in_order[:18]),
        "edges and corners, 20": norm(in_order[6:]),
        "six faces and an edge in turn": norm(_with_edges(in_order[:6], in_order[6:18])),
    }
    for n in (24, 48):
        k = np.arange(n) + 0.5
        z, turn = 1 - 2 * k / n, np.pi * (1 + 5**0.5) * k
        spread = np.stack(
            [np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], 1
        )
        made[f"{n} spread over the sphere"] = rng.permutation(spread)
    return made


def _with_edges(faces: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """All faces before each edge; the first three edges lie in three planes."""
    plane = np.abs(edges) @ [0, 1, 2]  # 1, 2 and 3
    order = np.stack([np.flatnonzero(plane == k) for k in (1, 2, 3)], axis=1).ravel()
    return np.concatenate([np.vstack([faces, edge]) for edge in edges[order]])


def planned(
    rng: np.random.Generator, device: Device, plan: np.ndarray, *, asked: bool
) -> tuple[np.ndarray, int]:
    """For each of `LENGTHS` whether all errors are within their limits, and where asked when `live` would stop."""
    rests: list[Rest] = []
    good, said, found = np.zeros(len(LENGTHS), bool), int(LENGTHS[-1]), None
    for made in range(1, LENGTHS[-1] + 1):
        up = held(rng, plan[(made - 1) % len(plan)])
        if rng.random() >= REFUSED:
            rests.append(rest_of(rng, device, up, len(rests) + 1))
        where = np.flatnonzero(LENGTHS == made)
        if not len(where):
            continue
        vector = least_squares(np.array([r.accel for r in rests]))
        error = vector - device.truth
        good[where[0]] = np.all(np.abs(error) <= limits())
        if asked and said == LENGTHS[-1]:
            found = estimate(rests, CAMPAIGN, TARGET, found)
            said = made if found.reached else said
    return good, said


def by_means(seeds: range) -> None:
    """Sessions that are fed with the means of rests."""
    begin = time.perf_counter()
    made, reached, true, inside, each = [], 0, 0, [], []
    for seed in seeds:
        rng = np.random.default_rng([1, seed])
        device = Device(rng)
        count, found, said = adaptive(rng, device)
        error = device.errors(found)
        std = np.array([p["std"] for n, p in found.parameters().items()], float)
        made.append(count)
        reached += said
        true += said and bool(np.all(np.abs(error) <= limits()))
        each.append(np.abs(error[[0, 1, 2, 3, 5, 8]]) <= limits()[[0, 1, 2, 3, 5, 8]])
        inside.append(np.abs(error) <= 1.959964 * std)
    print(f"{len(seeds)} sessions by the means of rests, {time.perf_counter() - begin:.0f} s")
    print(
        f"  stopped with 'target reached': {reached}; all errors within their limits: {true} ({true / reached:.1%})"
    )
    print(f"  single errors within their limits: {np.mean(each):.1%}")
    print(
        f"  coverage of 95 % intervals: {np.mean(inside):.1%}; of each parameter "
        f"{' '.join(f'{x:.0%}' for x in np.mean(inside, axis=0))}"
    )
    print(
        f"  rests: mean {np.mean(made):.1f}, median {np.median(made):.0f}, "
        f"5 % {np.quantile(made, 0.05):.0f}, 95 % {np.quantile(made, 0.95):.0f}"
    )
    shortest = None
    for name, plan in plans(np.random.default_rng(7)).items():
        found = [
            planned(rng, Device(rng), plan, asked=False)
            for rng in (np.random.default_rng([1, seed]) for seed in seeds)
        ]
        share = np.mean([g for g, _ in found], axis=0)
        enough = LENGTHS[share >= 0.95]
        length = int(enough[0]) if len(enough) else int(LENGTHS[-1])
        print(f"  plan {name}: {length} rests for 95 % of the devices, by the truth")
        if shortest is None or length < shortest[0]:
            shortest = length, name, plan
    length, name, plan = shortest
    found = [
        planned(rng, Device(rng), plan, asked=True)
        for rng in (np.random.default_rng([1, seed]) for seed in seeds)
    ]
    by_statement = int(np.quantile([s for _, s in found], 0.95))
    print(
        f"  best plan: {name}; ratio of mean rests: {np.mean(made) / length:.2f} by the truth "
        f"({length}), {np.mean(made) / by_statement:.2f} by the same statement ({by_statement})"
    )


class Hand:
    """A device in a hand, sample by sample: 100 Hz, tremor while it is turned, taps while it lies."""

    def __init__(self, rng: np.random.Generator, device: Device):
        self.rng, self.device, self.up, self.time = rng, device, np.array([0.0, 0.0, 1.0]), 0.0

    def lies(self, seconds: float, tap: bool) -> np.ndarray:
        """Rows at rest; the scatter is an offset of the whole rest."""
        count = round(100 * seconds)
        offset = self.device.scatter * self.rng.standard_normal(3)
        rows = self._rows(np.tile(self.up, (count, 1)), np.zeros((count, 3)), offset)
        if tap:
            at = self.rng.integers(80, count - 80)
            ring = np.exp(-np.arange(40) / 4.0) * np.cos(0.9 * np.arange(40))
            rows[at : at + 40, 1:4] += 20.0 * self.device.noise * np.sqrt(400) * ring[:, None]
            rows[at : at + 40, 4:7] += 0.02 * ring[:, None]
        return rows

    def turns(self, up: np.ndarray, seconds: float) -> np.ndarray:
        """Rows of a turn to another direction of gravity."""
        count = round(100 * seconds)
        axis = np.cross(up, self.up)
        angle = np.arctan2(np.linalg.norm(axis), up @ self.up)
        axis = axis / max(np.linalg.norm(axis), 1e-12)
        share = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, count + 1) / count)
        tremor = (
            np.radians(1.0)
            * np.sin(2 * np.pi * 9.0 * np.arange(count) / 100)
            * np.sin(np.pi * share)
        )
        turned = -(angle * share + tremor)[:, None]
        u = self.up
        ups = u * np.cos(turned) + np.cross(axis, u) * np.sin(turned)
        rate = -np.gradient(turned[:, 0], 0.01)[:, None] * axis
        self.up = up
        return self._rows(ups, rate, np.zeros(3))

    def _rows(self, ups: np.ndarray, rate: np.ndarray, offset: np.ndarray) -> np.ndarray:
        count = len(ups)
        noise = self.device.noise * np.sqrt(
            400.0
        )  # of a sample: a rest of 4 s has the noise of a mean
        accel = GRAVITY * ups @ self.device.lower.T + self.device.bias + offset
        accel += noise * self.rng.standard_normal((count, 3))
        gyro = rate + [0.01, -0.02, 0.03] + 1e-3 * self.rng.standard_normal((count, 3))
        stamps = self.time + 0.01 * np.arange(count)
        self.time += 0.01 * count
        return np.column_stack([stamps, accel, gyro])


def by_rows(sessions: int) -> None:
    """Sessions sample by sample, in a closed loop with the events."""
    for seed in range(sessions):
        rng = np.random.default_rng([2, seed])
        device = Device(rng)
        hand, session, told = (
            Hand(rng, device),
            Session(CAMPAIGN, TARGET),
            np.array([0.0, 0.0, 1.0]),
        )
        made, took = 0, 0.0
        while not session.finished and made < LONGEST:
            made += 1
            rows = np.concatenate(
                [hand.turns(held(rng, told), 1.5), hand.lies(5.0, rng.random() < REFUSED)]
            )
            for part in np.array_split(rows, 65):
                recording = Recording(part[:, 0], accel=part[:, 1:4], gyro=part[:, 4:7])
                begin = time.process_time()
                for event in session.feed(recording, part[:, 0]):
                    if event["event"] == "next":
                        told = np.array(event["up"]) / np.linalg.norm(event["up"])
                took += time.process_time() - begin
        events = list(session.end())
        error = np.abs(device.errors(session.estimate))
        print(
            f"  by rows {seed}: {made} rests made, {len(session.accepted)} used, in {hand.time:.0f} s; "
            f"{'input ended' if events else 'stopped'}; within the limits: {bool(np.all(error <= limits()))}; "
            f"{100 * took / hand.time:.0f} % of a core"
        )


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sessions", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="the first session's seed")
    parser.add_argument("--rows", type=int, default=6)
    asked = parser.parse_args()
    by_means(range(asked.first, asked.first + asked.sessions))
    by_rows(asked.rows)


if __name__ == "__main__":
    main()
