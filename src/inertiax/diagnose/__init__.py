"""What the model left out: located, named, quantified and proved on held-out data."""

from .result import Diagnosis as Diagnosis
from .run import (
    diagnose as diagnose,
    diagnose_campaign as diagnose_campaign,
    run_diagnosis as run_diagnosis,
)
