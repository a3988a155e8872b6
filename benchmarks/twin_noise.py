"""How often `noise` finds a twin's own noise: its 95 % limits of N, B and K over logs of simulated devices.

    python benchmarks/twin_noise.py [--logs 200] [--part 1 --of 4] [--seconds 150]

Each twin rests for 164 s at 100 Hz; its three accelerometers are three logs. `--part` makes a share of them, each part
with devices of its own, and stops after `--seconds` with what it has. One sigma of a share of 0.95 over 200 logs is
0.015, so that 0.92 to 0.98 is what 200 logs can tell from 0.95.

Measured over 801 logs (one sigma 0.008): N 0.965, B 0.949, K 0.955.
"""

import argparse
import time

import jax
import jax.numpy as jnp
import numpy as np

import inertiax as ix
from inertiax.allan import identify


RATE, SIZE = 100.0, 1 << 14
TRUTH = {"N": 1e-3, "B": 5e-4, "K": 3e-4}  # m/s²/√Hz, m/s², m/s²/√s
AXES = 3


@jax.jit
def rest(key: jax.Array) -> jax.Array:
    """Accelerometers of one twin at rest, less the specific force."""
    twin = ix.Twin(ix.Calibration(9.81), {"accel": TRUTH}, sample_rate=RATE)
    still = jnp.zeros(3)
    start = twin.init(key, 20.0)
    step = lambda state, _: twin.step(state, still, still, 20.0)
    return jax.lax.scan(step, start, None, length=SIZE)[1][0]


def main() -> None:
    """Print each term's share of logs whose limits hold the truth."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--logs", type=int, default=200)
    parser.add_argument("--part", type=int, default=1)
    parser.add_argument("--of", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=150.0)
    given = parser.parse_args()
    end, inside, made = time.monotonic() + given.seconds, dict.fromkeys(TRUTH, 0), 0
    devices = np.arange(-(-given.logs // AXES))[given.part - 1 :: given.of]
    with jax.enable_x64(True):
        for device in devices.tolist():
            for log in np.asarray(rest(jax.random.PRNGKey(device))).T:
                found = identify(log, rate=RATE).terms
                made += 1
                for name, true in TRUTH.items():
                    inside[name] += found[name].lower <= true <= found[name].upper
            if time.monotonic() > end:
                break
    shares = "  ".join(f"{k} {v}/{made} = {v / made:.3f}" for k, v in inside.items())
    print(f"part {given.part} of {given.of}: {shares}", flush=True)


if __name__ == "__main__":
    main()
