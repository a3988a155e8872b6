"""The page of a session, served to this machine alone and to nobody without the token.

What keeps others out, in the order in which a request is looked at:

* the socket is bound to the loopback address;
* `Host` must be that address, so that no name that another site points here (DNS rebinding) is answered;
* `Origin` and `Sec-Fetch-Site`, which browsers set, must not be another site's, and no answer allows one (no CORS);
* only GET is answered: a page reads and cannot drive anything;
* the path begins with a token of 256 random bits, compared in constant time.
"""

import asyncio
import hmac
import importlib.util
import secrets
import socket
import threading
from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment, PackageLoader, StrictUndefined

from ..storage.whole_files import write_atomically
from .events import Event
from .page_feed import Feed


if TYPE_CHECKING:
    from tornado.web import Application

LOOPBACK = "127.0.0.1"
TOKEN = 32  # random bytes
MOST_HEADER = 16 * 1024  # bytes of a request
ENDS = 2.0  # s that pages have to take what still waits for them
_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
}
_PAGE_POLICY = (
    "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_FILE_POLICY = (
    "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src data:; "
    "base-uri 'none'; form-action 'none'"
)


def require_server() -> None:
    """Raises `ValueError`, one line, where the library that serves the page is not installed."""
    if importlib.util.find_spec("tornado") is None:
        raise ValueError("--page: the package tornado is missing: pip install 'inertiax[page]'.")


class PageServer:
    """Serves the page from a thread of its own; use as a context, and call it with each event."""

    def __init__(self, port: int = 0):
        """**Arguments:** `port`, 0 for a free one.

        Raises `ValueError` where the port is taken or the library is missing.
        """
        require_server()
        self._token = secrets.token_urlsafe(TOKEN)
        self._socket = _bound(port)
        self._port = self._socket.getsockname()[1]
        self._feed = Feed()
        self._loop = asyncio.new_event_loop()
        self._ready, self._ending = threading.Event(), asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)

    @property
    def port(self) -> int:
        """Where it listens."""
        return self._port

    @property
    def address(self) -> str:
        """What to open in a browser; whoever has it sees the page."""
        return f"http://{LOOPBACK}:{self._port}/{self._token}/"

    def __enter__(self) -> "PageServer":
        self._thread.start()
        self._ready.wait()
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._ending.set)
        self._thread.join(2.0 * ENDS)

    def __call__(self, event: Event) -> None:
        """Hand an event to the pages; does not wait for any."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._feed.publish, event)

    def save(self, path: Path) -> None:
        """The page as it is now in a file of its own, which needs no server; call it when the context has ended."""
        write_atomically(path, kept_page(self._feed.so_far()).encode())

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._ready.set()
            self._loop.close()

    async def _serve(self) -> None:
        from tornado.httpserver import HTTPServer

        server = HTTPServer(
            application(self._feed, self._token, self._port),
            max_header_size=MOST_HEADER,
            max_body_size=0,
            idle_connection_timeout=60.0,
        )
        server.add_socket(self._socket)
        self._ready.set()
        await self._ending.wait()
        server.stop()
        self._feed.close()
        until = self._loop.time() + ENDS
        while self._feed.clients and self._loop.time() < until:
            await asyncio.sleep(0.02)
        await server.close_all_connections()


def _bound(port: int) -> socket.socket:
    from tornado.netutil import bind_sockets

    try:
        (found,) = bind_sockets(port, LOOPBACK, family=socket.AF_INET)
    except OSError as error:
        raise ValueError(
            f"--port {port}: cannot be listened on ({error.strerror}); choose another one, or 0 for a free one."
        ) from None
    return found


def application(feed: Feed, token: str, port: int) -> "Application":
    """What answers requests: the page at /TOKEN/, its events at /TOKEN/events, nothing else."""
    from tornado.http1connection import HTTP1Connection
    from tornado.iostream import StreamClosedError
    from tornado.web import Application, HTTPError, RequestHandler

    hosts = tuple(f"{name}:{port}" for name in (LOOPBACK, "localhost"))

    class Guarded(RequestHandler):
        """Looks at a request before anything is made of it."""

        SUPPORTED_METHODS = ("GET",)

        def set_default_headers(self) -> None:
            self.clear_header("Server")
            for name, value in _HEADERS.items():
                self.set_header(name, value)

        def prepare(self) -> None:
            headers = self.request.headers
            if headers.get_list("Host") not in [[host] for host in hosts]:
                raise HTTPError(403)
            if any(o not in [f"http://{h}" for h in hosts] for o in headers.get_list("Origin")):
                raise HTTPError(403)
            if headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
                raise HTTPError(403)
            if self.request.method != "GET":
                self.set_header("Allow", "GET")
                raise HTTPError(405)
            said = self.request.path.split("/")[1]
            if not hmac.compare_digest(said.encode(), token.encode()):
                raise HTTPError(404)

        def write_error(self, status_code: int, **arguments: object) -> None:
            del arguments
            self.finish(f"{status_code}\n")

    class Nothing(Guarded):
        """Every other path."""

        def get(self) -> None:
            raise HTTPError(404)

    class Page(Guarded):
        """The page itself."""

        def get(self) -> None:
            nonce = secrets.token_urlsafe(16)
            self.set_header("Content-Security-Policy", _PAGE_POLICY.format(nonce=nonce))
            self.finish(page(nonce))

    class Events(Guarded):
        """Server-sent events (WHATWG HTML, section 9.2), until the session or the page ends."""

        def initialize(self) -> None:
            self._client = None

        async def get(self) -> None:
            joined = feed.join(self._drop)
            if joined is None:
                raise HTTPError(503)
            self._client, so_far = joined
            self.set_header("Content-Type", "text/event-stream; charset=utf-8")
            try:
                message = so_far
                while message is not None:
                    self.write(message)
                    await self.flush()
                    message = await self._client.queue.get()
            except StreamClosedError:
                pass  # the page was closed, or did not keep up
            finally:
                feed.leave(self._client)

        def _drop(self) -> None:
            connection = self.request.connection
            assert isinstance(connection, HTTP1Connection)
            connection.close()

        def on_connection_close(self) -> None:
            if self._client is not None:
                feed.leave(self._client)
                if self._client.queue.full():
                    self._client.queue.get_nowait()
                self._client.queue.put_nowait(None)
            super().on_connection_close()

    def unlogged(handler: RequestHandler) -> None:
        """Addresses hold the token, and the terminal is the session's."""

    return Application(
        [(r"/[^/]*/", Page), (r"/[^/]*/events", Events)],
        default_handler_class=Nothing,
        log_function=unlogged,
    )


def page(nonce: str) -> str:
    """The page as HTML, with its style and its script inside; they run under this nonce alone."""
    return _rendered(nonce=nonce, policy=None, events=None)


def kept_page(events: bytes) -> str:
    """The same as a file that shows `events`, a JSON list, and may load and send nothing."""
    nonce = secrets.token_urlsafe(16)
    # No "<" may end the element that holds them; in JSON it stands in strings alone.
    inside = events.decode().replace("<", "\\u003c")
    return _rendered(nonce=nonce, policy=_FILE_POLICY.format(nonce=nonce), events=inside)


def _rendered(**given: str | None) -> str:
    environment = Environment(
        loader=PackageLoader("inertiax", "templates"), undefined=StrictUndefined, autoescape=True
    )
    return environment.get_template("live.html").render(**given)
