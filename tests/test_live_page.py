"""`inertiax live --page`: who is let in, what a page is told, and that no page can hold the session up."""

import http.client
import json
import os
import pty
import re
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import inertiax
from browser import Browser, FOUND
from hard_limit import ends_within
from inertiax.cli.live import _Bell
from inertiax.data.recording import Recording
from inertiax.live.events import problem_event, state_event, withdrawn_event
from inertiax.live.page_feed import Feed, MOST_CLIENTS
from inertiax.live.page_server import PageServer
from inertiax.live.row_store import RowStore


START = {"event": "start", "target": "accel.bias=1 mg", "limits": {"accel.bias": 1e-3}, "hold": 4.0}
DONE = {"event": "done", "reason": "input ended", "rests": 1, "seconds": 6.0}
SCRIPT = Path(inertiax.__file__).parent / "templates" / "live.js"


def rest(number, accepted=True):
    why = None if accepted else "held by hand at 3.0 s"
    return {
        "event": "rest",
        "number": number,
        "start": 6.0 * number,
        "end": 6.0 * number + 4.0,
        "mean_accel": [0.0, 9.8, 0.1],
        "accepted": accepted,
        "why": why,
        "left_out": [],
    }


def state(up=(0.0, 0.0, 1.0), **more):
    made = {"event": "state", "moving": False, "time": 1.0, "up": list(up), "rate": 0.01}
    return made | {"temperature": 21.5, "noise": {"accel": 0.01, "gyro": 1e-3}} | more


@pytest.fixture
def server():
    with PageServer() as opened:
        yield opened


def asked(server, path, method="GET", **headers):
    """Answer to one request; header names with _ for -."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    said = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(method, path, headers=said)
    answer = connection.getresponse()
    answer.body = answer.read().decode()
    connection.close()
    return answer


def own_path(server):
    return "/" + server.address.split("/", 3)[3]


class Listener:
    """A page's stream of events, read by hand."""

    def __init__(self, server):
        self.socket = socket.create_connection(("127.0.0.1", server.port), timeout=10)
        path = own_path(server) + "events"
        self.socket.sendall(
            f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode()
        )
        self.rest, self.found, self.read = b"", [], 0

    def until(self, kind):
        """Events up to one of a kind that was not read before."""
        while not any(e["event"] == kind for e in self.found[self.read :]):
            assert self._more(), f"the stream ended before {kind}"
        self.read = len(self.found)
        return self.found

    def ends(self):
        """Whether the other side closes."""
        while self._more():
            pass
        return True

    def _more(self):
        data = self.socket.recv(1 << 20)
        *whole, self.rest = (self.rest + data).split(b"\n\n")
        whole = [x[x.index(b"data: ") + 6 :] for x in whole if b"data: " in x]
        self.found += [json.loads(x.split(b"\r\n")[0]) for x in whole]
        return bool(data)


@pytest.fixture
def listen():
    """Opens listeners, and closes them when the test is over."""
    opened = []

    def open_one(server):
        opened.append(Listener(server))
        return opened[-1]

    yield open_one
    for listener in opened:
        listener.socket.close()


def test_the_address_gives_the_page_and_nothing_is_loaded_from_elsewhere(server):
    answer = asked(server, own_path(server))
    assert answer.status == 200 and "inertiax live" in answer.body
    policy = answer.headers["Content-Security-Policy"]
    (nonce,) = set(re.findall(r"'nonce-([^']+)'", policy))
    assert policy.startswith("default-src 'none'") and "unsafe" not in policy
    assert re.findall(r'<(?:script|style) nonce="([^"]+)"', answer.body) == [nonce, nonce]
    addresses = re.findall(r"https?://[^\"' ]+", answer.body)
    assert addresses == ["http://www.w3.org/2000/svg"]  # a name of a format, not fetched
    again = asked(server, own_path(server)).headers["Content-Security-Policy"]
    assert nonce not in again


def test_only_the_token_opens_anything(server):
    token = own_path(server).strip("/")
    assert len(token) >= 43  # 256 bits in base64
    wrong = token[:-1] + ("A" if token[-1] != "A" else "B")
    for path in ("/", "/events", f"/{wrong}/", f"/{wrong}/events", f"/{token}", "/favicon.ico"):
        assert asked(server, path).status == 404, path
    assert asked(server, f"/{token}/other").status == 404
    assert asked(server, f"/{token[:20]}%00/").status == 404
    with PageServer() as other:
        assert own_path(other) != own_path(server)


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},  # a name that was made to point here
        {"Host": "127.0.0.1:1"},
        {"Origin": "https://evil.example"},
        {"Origin": "null"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
    ],
)
def test_another_site_is_refused_although_it_has_the_token(server, headers):
    for path in (own_path(server), own_path(server) + "events"):
        answer = asked(server, path, **headers)
        assert answer.status == 403 and answer.body == "403\n"


def test_the_page_itself_is_let_in_by_either_name(server):
    for name in ("127.0.0.1", "localhost"):
        host = f"{name}:{server.port}"
        answer = asked(
            server,
            own_path(server),
            Host=host,
            Origin=f"http://{host}",
            Sec_Fetch_Site="same-origin",
        )
        assert answer.status == 200


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "HEAD"])
def test_nothing_can_be_sent(server, method):
    answer = asked(server, own_path(server), method)
    assert answer.status == 405
    assert "Access-Control-Allow-Origin" not in answer.headers


def test_every_answer_is_kept_from_caches_frames_and_referrers(server):
    for path in (own_path(server), "/"):
        headers = asked(server, path).headers
        assert headers["Cache-Control"] == "no-store"
        assert headers["Referrer-Policy"] == "no-referrer"
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["X-Frame-Options"] == "DENY"
        assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
        assert headers["Content-Security-Policy"].startswith("default-src 'none'")
        assert "Server" not in headers and "Access-Control-Allow-Origin" not in headers


def test_only_the_loopback_address_is_listened_on(server):
    assert server._socket.getsockname()[0] == "127.0.0.1"


def test_of_an_error_that_is_withdrawn_a_new_page_hears_nothing():
    feed = Feed()
    feed.publish(problem_event("accel_unit", "error", "1 g reads 0.4"))
    assert json.loads(feed.so_far())[0]["statement"] == "1 g reads 0.4"
    feed.publish(withdrawn_event("accel_unit", "1 g reads 0.4"))
    assert json.loads(feed.so_far()) == []


def test_a_page_is_told_what_counts_so_far_and_then_what_comes(server, listen):
    for event in (START, rest(1), rest(2), state(), rest(1, accepted=False), state(rate=0.5)):
        server(event)
    listener = listen(server)
    found = listener.until("state")
    assert found == [START, rest(1, accepted=False), rest(2), state(rate=0.5)]
    server(rest(3))
    server(DONE)
    assert listener.until("done")[4:] == [rest(3), DONE]


def test_the_end_of_the_session_is_told_and_closes_the_stream(listen):
    with PageServer() as server:
        server(START)
        listener = listen(server)
        listener.until("start")
        server(DONE)
    assert listener.ends() and listener.found == [START, DONE]
    server(DONE)  # too late, and no error


def test_a_page_that_does_not_read_is_dropped_and_holds_nobody_up(server, listen):
    server(START)
    slow, quick = listen(server), listen(server)
    for listener in (slow, quick):
        listener.until("start")
    large = state(filler="x" * 100_000)
    with ends_within(120.0):  # whoever waits for the slow page waits for ever
        for number in range(400):  # 40 MB, more than the buffers of a connection
            server(large)
            if number % 20 == 19:
                server(rest(number))
                quick.until("rest")
        server(DONE)
        quick.until("done")
    deadline = time.monotonic() + 10.0
    while server._feed.clients > 1 and time.monotonic() < deadline:
        time.sleep(0.02)
    assert server._feed.clients == 1


def test_a_page_that_is_closed_is_forgotten(server, listen):
    server(START)
    listener = listen(server)
    listener.until("start")
    assert server._feed.clients == 1
    listener.socket.close()
    deadline = time.monotonic() + 10.0
    while server._feed.clients and time.monotonic() < deadline:
        time.sleep(0.02)
    assert server._feed.clients == 0


def test_so_many_pages_and_no_more(server, listen):
    server(START)
    opened = [listen(server) for _ in range(MOST_CLIENTS)]
    for listener in opened:
        listener.until("start")
    assert asked(server, own_path(server) + "events").status == 503


def test_the_state_is_that_of_the_newest_rows():
    store = RowStore("a")
    rng = np.random.default_rng(5)
    time_, count = np.arange(400) * 0.01, 400
    accel = np.array([0.0, 6.0, 8.0]) + 0.02 * rng.standard_normal((count, 3))
    gyro = np.array([0.0, 0.3, 0.4]) + 0.003 * rng.standard_normal((count, 3))
    accel[:200] = [9.8, 0.0, 0.0]
    rows = Recording(time_, accel=accel, gyro=gyro, temperature=np.full((count, 1), 21.5))
    store.add(rows, time_)
    found = state_event(store, 0.01, moving=False)
    # The mean of ten rows: 0.02 / 10 / sqrt(10) rad to a component, five of them allowed.
    np.testing.assert_allclose(found["up"], [0.0, 0.6, 0.8], atol=0.0035)
    np.testing.assert_allclose(found["rate"], 0.5, atol=5 * 0.003 / np.sqrt(10))
    assert found["temperature"] == 21.5 and found["time"] == pytest.approx(3.99)
    # 300 numbers tell a standard deviation to 4 %.
    assert found["noise"]["accel"] == pytest.approx(0.02, rel=0.2)
    assert found["noise"]["gyro"] == pytest.approx(0.003, rel=0.2)
    assert state_event(store, 0.01, moving=True)["noise"] == {}
    assert state_event(RowStore("b"), 0.01, moving=False) is None


def run(arguments, capsys):
    from inertiax.cli.app import run as run_command

    with pytest.raises(SystemExit) as caught:
        run_command(["live", *map(str, arguments)])
    shown = capsys.readouterr().err
    return caught.value.code, shown


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "campaign"
    made.mkdir()
    (made / "campaign.toml").write_text(
        '[site]\ngravity = 9.81\n\n[recordings]\nfiles = ["log.csv"]\n'
    )
    return made


def test_without_the_library_one_line_says_what_to_install(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "tornado", None)
    code, shown = run([folder, "--page", "-o", tmp_path / "out"], capsys)
    assert code == 1 and shown.count("\n") == 1 and "pip install 'inertiax[page]'" in shown
    assert not (tmp_path / "out").exists()


def test_a_port_that_is_taken_is_one_line(folder, tmp_path, capsys, server):
    arguments = [folder, "--page", "--port", server.port, "-o", tmp_path / "out"]
    code, shown = run(arguments, capsys)
    assert code == 1 and shown.count("\n") == 1 and f"--port {server.port}" in shown
    code, shown = run([folder, "--port", 0, "-o", tmp_path / "out"], capsys)
    assert code == 2 and shown.count("\n") == 1 and "--page" in shown


def test_the_bell_rings_at_a_terminal_for_each_rest_and_at_the_end(monkeypatch):
    ours, theirs = pty.openpty()
    next_ = {"event": "next", "statement": "turn", "provisional": True}
    with os.fdopen(theirs, "w") as terminal:
        monkeypatch.setattr(sys, "stderr", terminal)
        ring = _Bell()
        heard = []
        for event in (START, next_, rest(1), next_, rest(2, accepted=False), DONE):
            ring(event)
            os.write(theirs, b".")
            said = b""
            while not said.endswith(b"."):
                said += os.read(ours, 100)
            heard.append(said.count(b"\a"))
    os.close(ours)
    assert heard == [0, 1, 1, 0, 2, 1]


def test_the_bell_is_silent_where_nobody_sits(capsys):
    _Bell()(rest(1))
    assert capsys.readouterr().err == ""


# --- the script ------------------------------------------------------------------------------------

NODE = shutil.which("node")
CHECKS = """
const live = require(process.argv[1]);
const close = (a, b) => a.flat().every((x, k) => Math.abs(x - b.flat()[k]) < 1e-9);
let seed = 7;
const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647 - 0.5;
const out = { upright: true, followed: true };
for (let k = 0; k < 200; k++) {
  const up = live.unit([random(), random(), random()]);
  const turn = live.upright(up);
  out.upright &&= close(live.times(turn, up), [0, 0, 1]);
  const gram = turn.map((a) => turn.map((b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2]));
  out.upright &&= close(gram, [[1, 0, 0], [0, 1, 0], [0, 0, 1]]);
}
out.upright &&= close(live.times(live.upright([0, 0, -1]), [0, 0, -1]), [0, 0, 1]);
let known = live.begin();
for (let k = 0; k <= 90; k++) {
  const a = k * Math.PI / 180;
  known = live.after(known, { event: "state", up: [0, Math.sin(a), Math.cos(a)] });
  out.followed &&= close(live.times(known.attitude, [0, Math.sin(a), Math.cos(a)]), [0, 0, 1]);
}
out.axis = live.times(known.attitude, [1, 0, 0]);  // about which it was turned
out.top = live.seen([0, 0, 1], 77);
out.stated = live.stated({ value: -1.26e-3, std: 1e-4, limit: 1e-3, factor: 1e6, shown_unit: "µrad" });
out.share = [live.share({ std: 1, limit: 0.98 }), live.share({ std: 1, limit: 5 }), live.share({ std: 0, limit: 1 })];
let told = live.begin();
for (const event of [{ event: "start" }, { event: "rest", number: 1, accepted: true },
  { event: "rest", number: 1, accepted: false }, { event: "problem" }, { event: "done" }])
  told = live.after(told, event);
out.told = [told.rests[1].accepted, told.problems.length, Boolean(told.done)];
told = live.after(told, { event: "problem", statement: "1 g reads 0.4" });
out.wrong = told.problems.length;
told = live.after(told, { event: "problem", withdraws: "1 g reads 0.4" });
out.withdrawn = told.problems.length;
told = live.after(told, { event: "start" });
out.again = [Object.keys(told.rests).length, told.problems.length, Boolean(told.done)];
console.log(JSON.stringify(out));
"""


@pytest.mark.skipif(NODE is None, reason="no node to run the page's script with")
def test_the_geometry_and_the_state_of_the_script(tmp_path):
    script = tmp_path / "live.js"
    script.write_bytes(SCRIPT.read_bytes())
    made = subprocess.run(
        [NODE, "-e", CHECKS, str(script)], capture_output=True, text=True, timeout=60
    )
    assert made.returncode == 0, made.stderr
    out = json.loads(made.stdout)
    assert out["upright"] and out["followed"]
    np.testing.assert_allclose(out["axis"], [1.0, 0.0, 0.0], atol=1e-9)
    # The top seen from 20 deg above: up by cos 20 (y counts downwards), nearer by sin 20, whatever the azimuth.
    ahead = np.radians(20.0)
    np.testing.assert_allclose(out["top"], [0.0, -np.cos(ahead), np.sin(ahead)], atol=1e-9)
    assert out["stated"] == "−1260 ± 196 µrad, limit 1000"
    assert out["share"] == [pytest.approx(0.5), 1, 1]
    assert out["told"] == [False, 1, True] and out["again"] == [0, 0, False]
    assert (out["wrong"], out["withdrawn"]) == (2, 1)


def played(server):
    """A session in few events."""
    limited = {"value": 0.02, "std": 0.01, "unit": "m/s^2", "limit": 0.01}
    limited |= {"factor": 1.0, "shown_unit": "m/s²", "label": "bias x of the accelerometers"}
    server(START)
    server({"event": "problem", "kind": "clock", "severity": "warning", "statement": "<b>late</b>"})
    server(rest(1))
    server(rest(2, accepted=False))
    names = [f"accel.bias[{k}]" for k in range(3)] + ["accel.matrix[2,1]"]
    parameters = {name: limited for name in names}
    server({"event": "progress", "worst": names[3], "ratio": 3.1, "parameters": parameters})
    up = [0.0, 0.6, 0.8]
    said = "turn the device so that +z points up, tilted towards +y by 37 deg"
    server({"event": "next", "up": up, "statement": said, "gain": 0.4})
    server(state())


WAIT = "new Promise(done => setTimeout(done, 400))"  # ms; a page draws at its next frame


@pytest.mark.slow
@pytest.mark.skipif(FOUND is None, reason="no Chromium to lay the page out with")
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", [390, 1280])
def test_the_page_in_a_browser(width, dark, tmp_path):
    with PageServer() as server, Browser() as browser:
        played(server)
        browser.visit(server.address, width=width, dark=dark)
        browser.value(WAIT)
        text = lambda name: browser.value(f"document.getElementById('{name}').textContent")
        assert text("next").startswith("Turn the device so that +z") and text("status") == "resting"
        assert "<b>late</b>" in text("problems") and "held by hand" in text("rests")
        assert browser.value("document.querySelectorAll('#bars progress').length") == 4
        assert browser.value("document.querySelectorAll('#sphere .wanted').length") == 1
        assert browser.value("document.querySelectorAll('#sphere .covered').length") == 1
        assert text("temperature") == "21.5 °C" and text("noise-accel") == "1.02 mg"
        assert (browser.faults(), browser.errors) == ([], [])
        server(DONE)
        browser.value(WAIT)
        assert text("next").startswith("Done: input ended") and text("status") == "done"
        assert browser.errors == []


@pytest.mark.slow
@pytest.mark.skipif(FOUND is None, reason="no Chromium to lay the page out with")
@pytest.mark.parametrize("done", [False, True])
def test_the_page_that_is_kept_shows_the_same_without_a_server(done, tmp_path):
    with PageServer() as server:
        played(server)
        if done:
            server(DONE)
    server.save(tmp_path / "page.html")
    with Browser() as browser:
        browser.open(tmp_path / "page.html", width=390)
        browser.value(WAIT)
        text = lambda name: browser.value(f"document.getElementById('{name}').textContent")
        said = "Done: input ended" if done else "Turn the device so that +z"
        assert text("next").startswith(said) and text("status").startswith("kept after")
        assert "<b>late</b>" in text("problems") and "held by hand" in text("rests")
        assert browser.value("document.querySelectorAll('#bars progress').length") == 4
        assert browser.value("document.querySelectorAll('#sphere .covered').length") == 1
        assert (browser.faults(), browser.errors) == ([], [])


def test_the_page_that_is_kept_holds_the_events_and_runs_nothing_else(tmp_path):
    with PageServer() as server:
        server({"event": "problem", "kind": "clock", "severity": "error", "statement": "</script>"})
        server(rest(1))
    server.save(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    (inside,) = re.findall(r'<script type="application/json"[^>]*>(.*?)</script>', text, re.DOTALL)
    problem, only = json.loads(inside)
    assert problem["statement"] == "</script>" and only == rest(1)
    (policy,) = re.findall(r'<meta http-equiv="Content-Security-Policy" content="(.*?)">', text)
    assert "default-src &#39;none&#39;" in policy and "connect-src" not in policy
    (nonce,) = set(re.findall(r'nonce="(.*?)"', text))
    assert f"script-src &#39;nonce-{nonce}&#39;" in policy


@pytest.mark.slow
@pytest.mark.skipif(FOUND is None, reason="no Chromium to try it with")
def test_a_page_of_another_origin_can_read_and_frame_nothing(tmp_path):
    with PageServer() as server, Browser() as browser:
        played(server)
        other = tmp_path / "other.html"
        other.write_text(f'<iframe id="f" src="{server.address}"></iframe>')
        browser.open(other, width=1280)
        browser.value(WAIT)
        address = json.dumps(server.address)
        tried = f"fetch({address}).then(a => a.text()).catch(() => 'refused')"
        assert browser.value(tried) == "refused"
        stream = (
            f"new Promise(done => {{ const s = new EventSource({address} + 'events');"
            " s.onmessage = () => done('told'); s.onerror = () => done('refused'); })"
        )
        assert browser.value(stream) == "refused"
        assert browser.value("document.getElementById('f').contentDocument") is None
        assert server._feed.clients == 0


# --- the command -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_command_serves_its_session_until_it_ends(folder, tmp_path, listen):
    rng = np.random.default_rng(3)
    lines = ["time,accel_x,accel_y,accel_z,temperature"]
    for k in range(1200):
        x, y, z = np.array([0.0, 0.0, 9.81]) + 0.01 * rng.standard_normal(3)
        lines.append(f"{0.01 * k:.3f},{x:.5f},{y:.5f},{z:.5f},25.0")
    process = subprocess.Popen(
        [sys.executable, "-m", "inertiax", "live", folder, "-", "--page", "--json"]
        + ["-o", tmp_path / "out"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdin and process.stderr
    said = process.stderr.readline()
    found = re.fullmatch(r"page: http://127\.0\.0\.1:(\d+)/(\S+)/\n", said)
    assert found, said

    class Command:
        port, address = int(found[1]), said.split()[1]

    listener = listen(Command)
    process.stdin.write("\n".join(lines) + "\n")
    process.stdin.flush()
    listener.until("state")
    process.stdin.close()
    process.stdin = None
    listener.until("done")
    assert listener.ends()
    shown, _ = process.communicate(timeout=120)
    printed = [json.loads(line) for line in shown.splitlines()]
    streamed = [e for e in listener.found if e["event"] != "state"]
    # The page has the printed events, and states beside them.
    assert streamed == [e for e in printed if e in streamed] and printed[-1] == streamed[-1]
    assert {e["event"] for e in printed} >= {"start", "rest", "done"}
    states = [e for e in listener.found if e["event"] == "state"]
    assert states[-1]["temperature"] == 25.0 and states[-1]["up"][2] > 0.99
    kept = (tmp_path / "out" / "page.html").read_text()
    assert json.dumps(printed[-1]["reason"]) in kept
