"""What in a campaign cannot be right, by physics, before any fit: units, signs, axes, clock, temperature, rests."""

from .finding import Finding as Finding, Plausibility as Plausibility
from .pipeline import (
    check_campaign as check_campaign,
    require_plausible as require_plausible,
    statements as statements,
)
