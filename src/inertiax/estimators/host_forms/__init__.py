"""NumPy forms of the estimators, for one device at a time.

The estimators' JAX forms serve fleets, derivatives and users' pipelines. One device's small problem does not pay for
tracing and compiling them, seconds against milliseconds, so it is linearised here, all dwells at once and with
derivatives by hand. tests/test_host_forms.py holds both forms together to rounding.
"""

from ..base import AbstractEstimator
from ..gravity_rotation import GravityRotation
from ..invariant import Invariant
from ..reference_accel import ReferenceAccel
from ..reference_gyro import ReferenceGyro
from ..static import StaticAccel, StaticGyro
from .form import (
    AbstractHostForm as AbstractHostForm,
    LinearisedDwells as LinearisedDwells,
)
from .gravity_rotation import GravityRotationOnHost
from .invariant import InvariantOnHost
from .outputs import OutputsOnHost


_FORMS: dict[type, type[AbstractHostForm]] = {
    Invariant: InvariantOnHost,
    ReferenceAccel: OutputsOnHost,
    ReferenceGyro: OutputsOnHost,
    StaticAccel: OutputsOnHost,
    StaticGyro: OutputsOnHost,
    GravityRotation: GravityRotationOnHost,
}


def host_form(estimator: AbstractEstimator) -> AbstractHostForm | None:
    """The estimator's NumPy form; `None` where it has only its JAX form (a subclass may compute something else)."""
    form = _FORMS.get(type(estimator))
    return None if form is None else form(estimator)
