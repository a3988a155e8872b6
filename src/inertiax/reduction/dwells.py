"""Dwell means: one row per time at rest (or at constant rate), ready for estimation.

A dwell is reduced to its mean outputs, its mean temperature and the covariance of those means.
For a linear sensor model nothing is lost by that, and a solve costs microseconds instead of
milliseconds.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from .._jax import eqx, jax, jnp
from .._typing import AnyArray, Given
from ..data.recording import Recording
from ..physics.leaves import refuse_masked
from . import arrays
from .motions import Motions


# Shapes of one dwell's columns that are no single number.
_INNER = {
    "accel": (3,),
    "gyro": (3,),
    "reference_accel": (3,),
    "reference_gyro": (3,),
    "accel_covariance": (3, 3),
    "gyro_covariance": (3, 3),
    "mag": (3,),
    "mag_covariance": (3, 3),
    "rows": (4,),
    "wander": (6,),
}


class Dwells(eqx.Module):
    """Means over dwells. The leading axis counts dwells; absent columns are `None`.

    Under `vmap` one slice is one dwell, which is what an estimator's residual is written for.
    `valid` is False for rows that only pad an array to a common shape; they weigh nothing.
    """

    time: Float[AnyArray, " *dwell"]  # s, middle of the dwell
    duration: Float[AnyArray, " *dwell"]  # s
    count: Float[AnyArray, " *dwell"]  # samples averaged
    temperature: Float[AnyArray, " *dwell"]  # °C, mean; 0 where no probe was recorded
    experiment: Int[AnyArray, " *dwell"]  # number of the run of the programme
    position: Int[AnyArray, " *dwell"]  # -1 at constant rate
    valid: Bool[AnyArray, " *dwell"]  # False: a row that only pads
    accel: Float[AnyArray, "*dwell 3"] | None = None  # m/s²
    accel_covariance: Float[AnyArray, "*dwell 3 3"] | None = None  # of the mean, (m/s²)²
    gyro: Float[AnyArray, "*dwell 3"] | None = None  # rad/s
    gyro_covariance: Float[AnyArray, "*dwell 3 3"] | None = None  # of the mean, (rad/s)²
    # m/s²; exactly zero, which nothing on the ground feels, where the plan tells none.
    reference_accel: Float[AnyArray, "*dwell 3"] | None = None
    reference_gyro: Float[AnyArray, "*dwell 3"] | None = None  # rad/s
    motion: Motions | None = None  # the motion that led to each dwell, where an estimator needs it
    rows: Int[AnyArray, "*dwell 4"] | None = (
        None  # recording, first row, one past the last, segment
    )
    mag: Float[AnyArray, "*dwell 3"] | None = None  # T
    mag_covariance: Float[AnyArray, "*dwell 3 3"] | None = None  # of the mean, T²
    current: Float[AnyArray, " *dwell"] | None = None  # A, mean
    # Number of the positioning whose error several plateaus share, −1 where it is a dwell's own.
    positioning: Int[AnyArray, " *dwell"] | None = None
    # rad, 1 sigma of the error that is shared, and so not in the covariances; 0 where none is.
    shared_angle: Float[AnyArray, " *dwell"] | None = None
    move: Bool[AnyArray, " *dwell"] | None = None  # from rest to rest, see `known_moves`
    # Change of the references by 1 sigma of the table's errors, in no covariance: the first three columns as
    # `table_errors` has them, then those of `standing_axes`.
    table_accel: Float[AnyArray, "*dwell 3 error"] | None = None  # m/s²
    table_gyro: Float[AnyArray, "*dwell 3 error"] | None = None  # rad/s
    # Of a positioning's variance, the part that axes have which stand through several; not in the covariances.
    standing_part: Float[AnyArray, " *dwell"] | None = None
    # Rests that a hand held, if there are any: it turns a device, and pushes it nowhere for long, so |a| alone counts.
    held: Bool[AnyArray, " *dwell"] | None = None
    # °C, 1 sigma: what a probe's coarse steps hide of all temperatures, where they show (`rounded_temperature`).
    hidden_by_steps: Float[AnyArray, " *dwell"] | None = None
    # 1 sigma, m/s² of accelerometers and rad/s of gyros: what slow noise within a log's one rest gives to its
    # covariances (`wandering_rest`), where it shows.
    wander: Float[AnyArray, "*dwell 6"] | None = None

    def __check_init__(self):
        shape = jnp.shape(self.time)
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if value is None or field.name == "motion":
                continue
            refuse_masked(f"Dwells({field.name}=...)", value)
            inner = _INNER.get(field.name, ())
            if field.name in ("table_accel", "table_gyro"):
                inner = (3, *jnp.shape(value)[-1:])
            if jnp.shape(value) != (*shape, *inner):
                raise ValueError(
                    f"`Dwells({field.name}=...)`: shape {jnp.shape(value)}, but `time` has {shape}, so it must be "
                    f"{(*shape, *inner)}."
                )

    @classmethod
    def from_arrays(
        cls,
        accel: Given | None = None,
        gyro: Given | None = None,
        *,
        temperature: Given | None = None,
        experiment: Given | None = None,
        position: Given | None = None,
        sigma: Given | None = None,
        reference_accel: Given | None = None,
        reference_gyro: Given | None = None,
        valid: Given | None = None,
    ) -> "Dwells":
        """Dwell means from arrays; any leading axes are devices.

        **Arguments:** outputs (m/s², rad/s) and references (…, dwells, 3); `temperature` in °C, `experiment`,
        `position` and `valid` (…, dwells). `position` is −1 at constant rate (by default where `reference_gyro`
        says that the device turns). `sigma` is 1 sigma of a mean: one number, by axis (3,), by dwell (…, dwells) or by
        output (…, dwells, 3), where (3,) is always by axis; or covariances (…, dwells, 3, 3). It is a pair where there
        are both triads; absent: found from the residuals. Rows that are not `valid` may hold anything.

        Raises `ValueError`, one line that names the argument, for shapes that do not fit and for numbers that are
        implausible in these units.
        """
        made = arrays.columns(accel, gyro, reference_accel, reference_gyro, temperature, valid)
        shape = made["valid"].shape
        own = arrays.sigmas(sigma, accel, gyro)
        row = np.arange(shape[-1], dtype=float)
        time = np.broadcast_to(row, shape)
        turning = made["reference_gyro"]
        poses = row if turning is None else np.where(_turns(turning), -1.0, row)
        return cls(
            time=time,
            duration=np.ones(shape),
            count=np.ones(shape),
            experiment=arrays.labels("experiment", experiment, shape, 0),
            position=arrays.labels("position", position, shape, poses),
            accel_covariance=arrays.covariance("accel", own[0], made["accel"], made["valid"]),
            gyro_covariance=arrays.covariance("gyro", own[1], made["gyro"], made["valid"]),
            **made,
        )

    @property
    def num_dwells(self) -> int:
        """Length of the leading axis."""
        return int(self.time.shape[0])

    def __getitem__(self, rows: slice | int | np.ndarray) -> "Dwells":
        """The same columns, only those dwells."""
        return jax.tree.map(lambda x: x[rows], self)


def without_held(dwells: Dwells) -> Dwells:
    """The dwells without the rests that a hand held."""
    if dwells.held is None:
        return dwells
    kept = eqx.tree_at(lambda d: d.held, dwells, None)
    return kept[np.flatnonzero(~np.asarray(dwells.held))]


def is_told(reference_accel: Float[AnyArray, "*dwell 3"]) -> Bool[AnyArray, " *dwell"]:
    """Where the plan tells a specific force: a reference of exactly zero is none.

    A station that writes nothing while its table turns leaves zeros, and no device on the ground feels none.
    """
    library = np if isinstance(reference_accel, np.ndarray) else jnp
    return library.asarray(library.any(library.asarray(reference_accel) != 0.0, axis=-1))


def known_force(
    stated: Float[AnyArray, "*dwell 3"] | None, felt: Float[AnyArray, "*dwell 3"] | None
) -> Float[AnyArray, "*dwell 3"] | None:
    """Specific force, m/s²: the reference where there is one, else the (compensated) outputs."""
    if stated is None or felt is None:
        return felt if stated is None else stated
    library = np if isinstance(stated, np.ndarray) and isinstance(felt, np.ndarray) else jnp
    return library.where(is_told(stated)[..., None], stated, felt)


def check_dwells(call: str, dwells: object) -> None:
    """Raise `ValueError` for what is no `Dwells`, with the call that makes them of it."""
    if isinstance(dwells, Dwells):
        return
    cure = "make them by `Dwells.from_arrays(accel, gyro)`"
    if isinstance(dwells, Recording):
        cure = "a recording's are `reduce_to_dwells(recording)`"
    raise ValueError(f"`{call}`: {type(dwells).__name__} is no Dwells; {cure}.")


def with_harmless_padding(dwells: Dwells) -> Dwells:
    """Rows that are not valid, where they hold zeros or no numbers, as each device's first valid row."""
    valid = np.asarray(dwells.valid)
    outputs = [x for x in (dwells.accel, dwells.gyro) if x is not None]
    padding = [np.square(np.asarray(x)[~valid]).sum(axis=-1) for x in outputs]
    if valid.all() or all(np.all((p > 0.0) & np.isfinite(p)) for p in padding):
        return dwells
    kept = eqx.tree_at(lambda d: d.valid, dwells, None)
    filled = jax.tree.map(lambda x: arrays.filled(np.asarray(x), valid), kept)
    return eqx.tree_at(lambda d: d.valid, filled, valid, is_leaf=lambda x: x is None)


def _turns(reference_gyro: AnyArray) -> np.ndarray | jax.Array:
    """Where a device turns by more than the Earth does."""
    library = np if isinstance(reference_gyro, np.ndarray) else jnp
    return library.linalg.norm(reference_gyro, axis=-1) > arrays.TURNING


def experiment_rows(
    dwells: Dwells,
) -> tuple[Int[np.ndarray, "experiments longest"], Bool[np.ndarray, "experiments longest"]]:
    """Rows of each experiment's valid dwells, padded to the longest, and which are no padding.

    Padding repeats the experiment's last dwell, so that every number stays finite. Experiments are
    in the order of their numbers.
    """
    valid = np.asarray(dwells.valid)
    labels = np.asarray(dwells.experiment)
    rows = [np.flatnonzero((labels == n) & valid) for n in np.unique(labels[valid])]
    longest = max(len(r) for r in rows)
    index = np.stack([np.pad(r, (0, longest - len(r)), mode="edge") for r in rows])
    kept = np.stack([np.arange(longest) < len(r) for r in rows])
    return index, kept


def by_experiment(
    dwells: Dwells,
    rows: Int[AnyArray, "experiments longest"],
    kept: Bool[AnyArray, "experiments longest"],
) -> Dwells:
    """Stack the dwells of each experiment along a new leading axis, as `experiment_rows` says."""
    stacked = jax.tree.map(lambda x: jnp.asarray(x)[rows], dwells)
    return eqx.tree_at(lambda d: d.valid, stacked, stacked.valid & jnp.asarray(kept))
