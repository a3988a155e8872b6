"""What the model left out: located, named, quantified and proved on held-out data."""

from .audit import audit as audit
from .hold_out import (
    hold_out as hold_out,
    leave_positions_out as leave_positions_out,
    Prediction as Prediction,
)
from .learn_noise import learn_noise as learn_noise
from .limits import Audit as Audit
from .noise_file import read_noise as read_noise, write_noise as write_noise
from .population_noise import TypeNoise as TypeNoise
from .result import Diagnosis as Diagnosis
from .run import (
    diagnose as diagnose,
    diagnose_campaign as diagnose_campaign,
    diagnose_model as diagnose_model,
    run_diagnosis as run_diagnosis,
)
