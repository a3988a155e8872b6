"""The tutorial's case, from recording to conclusion: `python docs/tutorials/concealed_effect.py [FOLDER]`.

Writes two campaigns, diagnoses the first, and compensates the second, which was never fitted to. Figures go to
FOLDER (without one, to `concealed-effect/` beside this script); the words go to standard output.
"""

import sys
import tempfile
from pathlib import Path

import jax
import numpy as np
import polars as pl

from inertiax.calibration.quantities import DEG_PER_HOUR
from inertiax.data.campaign import load_campaign
from inertiax.diagnose import audit, diagnose_campaign
from inertiax.exports.compensated_recording import compensate_recording
from inertiax.plots import residuals as draw
from inertiax.plots.style import COLOURS, drawing, legend_above, new_figure, save_png
from inertiax.report.audit import size_rows


CAMPAIGN = """[site]
gravity = 9.81
[recordings]
files = ["*.csv"]
[device]
grade = "tactical"
[model]
gyro_estimator = "static"
temperature_degree = 3
"""


def chamber(corners, temperatures, seconds):
    """Probe temperature, °C at 1 Hz: straight ramps and soaks, smoothed by the device's 40 s."""
    time = np.arange(float(seconds))
    air, probe = np.interp(time, corners, temperatures), np.empty(seconds)
    state = air[0]
    for k, value in enumerate(air):
        state += (value - state) / 40.0
        probe[k] = state
    return time, probe


def concealed(probe):
    """What the model does not know, rad/s: gyro x hangs 6 °C behind on either branch."""
    state, made = probe[0], np.empty(len(probe))
    for k, value in enumerate(probe):
        state = min(max(state, value - 6.0), value + 6.0)
        made[k] = 6e-6 * (state - value) / 6.0
    return made


def record(folder, seed, time, probe):
    """A gyro triad at rest in one pose, its biases cubic in temperature, as a campaign folder."""
    rng = np.random.default_rng(seed)
    x = (probe - 20.0) / 30.0
    output = 1e-4 * np.stack([x - 0.3 * x**2, 0.5 * x + 0.2 * x**3, x**2], axis=1)
    output[:, 0] += concealed(probe)
    output += 2e-6 * rng.standard_normal(output.shape)
    columns = {"time": time, "temperature": probe + 0.003 * rng.standard_normal(len(probe))}
    columns |= {f"gyro_{a}": output[:, k] for k, a in enumerate("xyz")}
    columns |= {"position": np.zeros(len(time), int)}
    folder.mkdir(parents=True)
    pl.DataFrame(columns).write_csv(folder / "log.csv")
    (folder / "campaign.toml").write_text(CAMPAIGN)
    return load_campaign(folder / "campaign.toml")


def unseen(recording, plain, augmented):
    """The second recording, compensated without and with the effect; its figure and two rms in °/h."""
    minutes = recording.time / 60.0
    figure, (above, below) = new_figure(2, 1, height=3.6, sharex=True)
    above.plot(minutes, recording.temperature[:, 0], color=COLOURS[2])
    above.set_ylabel("temperature, °C")
    sizes = []
    for k, (calibration, name) in enumerate(
        ((plain, "without the effect"), (augmented, "with the effect"))
    ):
        rate = DEG_PER_HOUR * compensate_recording(calibration, recording)[1][:, 0]
        sizes.append(float(np.sqrt(np.mean(rate**2))))
        means = rate[: len(rate) // 10 * 10].reshape(-1, 10).mean(axis=1)
        below.plot(minutes[5::10][: len(means)], means, ".", color=COLOURS[1 - k], label=name)
    below.set_ylabel("compensated gyro x, °/h")
    below.set_xlabel("time, min")
    legend_above(below, columns=2)
    return figure, sizes


def main(figures):
    jax.config.update("jax_enable_x64", True)
    figures.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as home:
        first = record(Path(home) / "first", 11, *chamber(
            [0, 300, 1500, 2000, 3200, 3600, 4300, 5000], [-10, -10, 50, 50, -10, -10, 50, 50], 5000
        ))  # fmt: skip
        second = record(Path(home) / "second", 12, *chamber(
            [0, 200, 900, 1500, 2100, 3000], [0, 0, 40, 10, 45, -5], 3000
        ))  # fmt: skip
    plan = audit(first, estimate_noise=True)
    for row in size_rows(plan):
        print("from", row[2], row[-1], "on:", row[0])
    found, augmented = diagnose_campaign(first)
    print(found.verdict, [e.name for e in found.effects])
    print(found.summary)
    # The same fit without the effect is what a calibration of the first campaign would have given.
    plain, _ = calibrated(first)
    with drawing():
        (rows,) = found.residuals
        save_png(
            draw.before_and_after(rows, "temperature_branch", ("gyro_x",)), figures / "branches.png"
        )
        save_png(draw.over_time(rows), figures / "over-time.png")
        figure, sizes = unseen(second.recordings[0], plain, augmented)
        save_png(figure, figures / "unseen.png")
    print("unseen recording: rms of gyro x {:.3f} °/h without, {:.3f} °/h with".format(*sizes))
    return found, sizes


def calibrated(campaign):
    """The calibration of the model as meant: the diagnosis with an empty catalogue names nothing."""
    found, calibration = diagnose_campaign(campaign, effects=())
    return calibration, found


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "concealed-effect")
