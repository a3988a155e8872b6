"""`type-noise.json`: what several units told of the noise of their type."""

from pathlib import Path

import msgspec
import numpy as np

from ...data.json_documents import decode, encode
from ...data.recording import Rig
from ...storage.whole_files import write_atomically
from .state_space import NUM_VARIANCES, Variances
from .type_noise import ChainNoise, TypeNoise


SCHEMA = "inertiax.type-noise/1"
NAMES = list(Variances.__dataclass_fields__)  # white, flicker, walk, ...


class _Chain(msgspec.Struct, forbid_unknown_fields=True):
    label: str
    unit: str  # of the square root of a variance
    mean: list[float]
    covariance: list[list[float]]
    scatter: list[float]


class _Rig(msgspec.Struct, forbid_unknown_fields=True):
    position_uncertainty: float | None  # rad
    rate_uncertainty: float | None  # relative
    temperature_uncertainty: float | None  # °C


class _LeftOut(msgspec.Struct, forbid_unknown_fields=True):
    unit: str
    why: str


class _File(msgspec.Struct, forbid_unknown_fields=True):
    schema: str
    units: list[str]
    left_out: list[_LeftOut]
    rig: _Rig
    log_variances: list[str]  # names, in the order of every mean
    chains: list[_Chain]
    diagnosed: bool | None = None  # each unit, before it told; older files do not say


def write_noise(noise: TypeNoise, path: Path) -> None:
    """Write `type-noise.json`, whole or not at all."""
    chains = [
        _Chain(c.label, _unit(c.label), c.mean.tolist(), c.covariance.tolist(), c.scatter.tolist())
        for c in noise.chains
    ]
    rig = noise.rig
    content = _File(
        SCHEMA,
        list(noise.units),
        [_LeftOut(*one) for one in noise.left_out],
        _Rig(rig.position_uncertainty, rig.rate_uncertainty, rig.temperature_uncertainty),
        NAMES,
        chains,
        noise.diagnosed,
    )
    write_atomically(path, encode(content, str(path), indent=1))


def read_noise(path: Path) -> TypeNoise:
    """Read `type-noise.json`. Raises `ValueError`, one line naming file and key, for anything else."""
    try:
        stored = Path(path).read_bytes()
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror}).") from error
    content = decode(stored, _File, str(path), "the noise of a type", SCHEMA)
    if content.log_variances != NAMES:
        raise ValueError(f"{path}: log_variances must be {NAMES}.")
    if not content.chains:
        raise ValueError(f"{path}: 'chains' is empty.")
    labels = [c.label for c in content.chains]
    if len(set(labels)) < len(labels):
        raise ValueError(f"{path}: a label stands twice in 'chains'.")
    return TypeNoise(
        tuple(_chain(c, str(path)) for c in content.chains),
        Rig(
            content.rig.position_uncertainty,
            content.rig.rate_uncertainty,
            content.rig.temperature_uncertainty,
        ),
        tuple(content.units),
        tuple((one.unit, one.why) for one in content.left_out),
        content.diagnosed,
    )


def _unit(label: str) -> str:
    return "m/s^2" if "accel" in label else "rad/s"


def _chain(chain: _Chain, where: str) -> ChainNoise:
    rows, n = chain.covariance, NUM_VARIANCES
    if {len(chain.mean), len(chain.scatter), len(rows), *map(len, rows)} != {n}:
        raise ValueError(
            f"{where}: {chain.label} needs {n} means, {n} scatters and {n} rows of {n} covariances."
        )
    if chain.unit != _unit(chain.label):
        raise ValueError(
            f"{where}: {chain.label}: unit is {chain.unit!r}; it must be {_unit(chain.label)!r}."
        )
    mean, covariance = np.array(chain.mean), np.array(rows)
    finite = np.isfinite(mean).all() and np.isfinite(covariance).all()
    if not finite or not np.allclose(covariance, covariance.T, rtol=1e-9, atol=0.0):
        raise ValueError(f"{where}: {chain.label}: the covariance must be symmetric and finite.")
    if np.linalg.eigvalsh(covariance)[0] <= 0.0:
        raise ValueError(f"{where}: {chain.label}: the covariance must be positive definite.")
    return ChainNoise(chain.label, mean, covariance, np.array(chain.scatter))
