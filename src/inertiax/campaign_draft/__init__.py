"""From a log that nobody described to the `campaign.toml` that fits it."""

from .pipeline import Draft as Draft, draft_campaign as draft_campaign
