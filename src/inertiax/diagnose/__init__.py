"""What the model left out: located, named, quantified and proved on held-out data."""

from .audit import audit as audit
from .hold_out import (
    hold_out as hold_out,
    leave_positions_out as leave_positions_out,
    Prediction as Prediction,
)
from .limits import Audit as Audit
from .result import Diagnosis as Diagnosis
from .run import (
    diagnose as diagnose,
    diagnose_campaign as diagnose_campaign,
    diagnose_model as diagnose_model,
    run_diagnosis as run_diagnosis,
)
