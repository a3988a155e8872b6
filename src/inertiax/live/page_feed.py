"""Events to the pages that are open: what counts so far for a new one, and a short queue to each.

Whoever makes the events never waits: a page that does not keep up is dropped, and gets everything that still counts
when it comes back.
"""

import asyncio
import dataclasses
from collections.abc import Callable

import msgspec

from .events import Event


MOST_CLIENTS = 8  # pages at once, a person's and a few spare ones
WAITING = 64  # messages that a page may be behind: six seconds of states


@dataclasses.dataclass(eq=False)
class Client:
    """One page that is open."""

    drop: Callable[[], None]  # ends its connection
    queue: asyncio.Queue[bytes | None] = dataclasses.field(
        default_factory=lambda: asyncio.Queue(WAITING)
    )


class Feed:
    """What was published, for the pages of one session. All of it runs in one event loop."""

    def __init__(self) -> None:
        self._kept: dict[tuple, bytes] = {}  # as JSON
        self._clients: set[Client] = set()

    @property
    def clients(self) -> int:
        """How many pages are open."""
        return len(self._clients)

    def publish(self, event: Event) -> None:
        """An event to every page; a page that is too far behind is dropped."""
        said = msgspec.json.encode(event)
        if "withdraws" in event:  # neither counts any longer
            self._kept.pop(("problem", event["kind"], event["withdraws"]), None)
        else:
            self._kept[_identity(event)] = said
        message = _sent(said)
        for client in tuple(self._clients):
            try:
                client.queue.put_nowait(message)
            except asyncio.QueueFull:
                self.leave(client)
                client.drop()

    def join(self, drop: Callable[[], None]) -> tuple[Client, bytes] | None:
        """A new page, and what counts so far in one piece; `None` where there are too many."""
        if len(self._clients) >= MOST_CLIENTS:
            return None
        client = Client(drop)
        self._clients.add(client)
        return client, b"".join(_sent(said) for said in self._kept.values())

    def so_far(self) -> bytes:
        """What counts so far, a JSON list of events."""
        return b"[" + b",".join(self._kept.values()) + b"]"

    def leave(self, client: Client) -> None:
        """A page that was closed."""
        self._clients.discard(client)

    def close(self) -> None:
        """Nothing more comes: each page is told so behind what it still waits for."""
        for client in tuple(self._clients):
            try:
                client.queue.put_nowait(None)
            except asyncio.QueueFull:
                self.leave(client)
                client.drop()


def _sent(said: bytes) -> bytes:
    """One event of a stream of server-sent events."""
    return b"data: " + said + b"\n\n"


def _identity(event: Event) -> tuple:
    """Events of one identity replace each other: a rest its earlier verdict, the rest of them what was said before."""
    kind = event["event"]
    if kind == "rest":
        return kind, event["number"]
    if kind == "problem":
        return kind, event["kind"], event["statement"]
    return (kind,)
