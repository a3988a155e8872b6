"""Plausibility asked by a twin of this process while it estimates.

The checks need nothing of the estimate and it nothing of them, and they take half as long as it. A command that runs
alone has a processor for them; a fleet's workers, which have all of them, do not.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

from ..data.recording import Campaign
from ..data.stored_recording import StoredRecording
from ..numerics.forked_work import can_fork, ForkedWork
from ..reduction.segments import Segments
from .finding import Finding, Plausibility
from .pipeline import check_campaign, required


_spare: ContextVar[bool] = ContextVar("spare", default=False)


@contextmanager
def spare_processor() -> Iterator[None]:
    """What calibrates within the block may have its checks done by a twin: it is the only work of this process."""
    token = _spare.set(True)
    try:
        yield
    finally:
        _spare.reset(token)


class Asked:
    """The checks of a campaign, begun in a twin where one is to be had; otherwise done at once.

    **Arguments:** as those of `require_plausible`, which raises here at once where there is no twin.
    """

    def __init__(self, campaign: Campaign, *, force: bool, as_recorded: Sequence[Segments] | None):
        self._campaign, self._force = campaign, force
        work = lambda _: check_campaign(campaign, as_recorded=as_recorded)
        # Parts of long logs are read by libraries whose threads a twin lacks.
        stored = any(isinstance(r, StoredRecording) for r in campaign.recordings)
        self._twin: ForkedWork[Plausibility] | None = None
        self._seen: Plausibility | None = None
        if _spare.get() and not stored and can_fork():
            self._twin = ForkedWork(work)
        else:
            self._seen = work(None)
            self.findings()

    def findings(self) -> tuple[Finding, ...]:
        """What was found; raises `ValueError` for an error as `require_plausible` does, whenever it is asked."""
        if self._seen is None:
            assert self._twin is not None
            self._seen = self._twin.result(lambda _: None)
        return required(self._campaign, self._seen, force=self._force)

    def end(self) -> None:
        """End the twin, whatever it has found."""
        if self._twin is not None:
            self._twin.end()
