"""What the model left out: located, named, quantified and proved on held-out data."""

from .held_out_stretch import (
    hold_out as hold_out,
    leave_positions_out as leave_positions_out,
    Prediction as Prediction,
)
from .learn_type_noise import learn_noise as learn_noise
from .noise.type_noise import TypeNoise as TypeNoise
from .noise.type_noise_file import read_noise as read_noise, write_noise as write_noise
from .pipeline import (
    diagnose as diagnose,
    diagnose_campaign as diagnose_campaign,
    diagnose_model as diagnose_model,
    run_diagnosis as run_diagnosis,
)
from .plan.detectability import audit as audit
from .plan.limits import Audit as Audit
from .result import Diagnosis as Diagnosis
