"""A campaign with the outputs of its log."""

from ..._jax import eqx
from ...data.recording import Campaign
from ...data.recording_order import in_order
from .blocks import Log


def with_outputs(campaign: Campaign, log: Log) -> Campaign:
    """The campaign with the outputs of its log, whose rows are those of the recordings in order of time.

    Its recordings stay in their own order, in which what was found in them is listed.
    """
    place = {id(r): k for k, r in enumerate(in_order(campaign.recordings))}
    made = []
    for recording in campaign.recordings:
        mine = log.recording == place[id(recording)]
        outputs = [None if x is None else x[mine] for x in (log.accel, log.gyro)]
        made.append(
            eqx.tree_at(
                lambda r: (r.accel, r.gyro), recording, outputs, is_leaf=lambda x: x is None
            )
        )
    return eqx.tree_at(lambda c: c.recordings, campaign, tuple(made))
