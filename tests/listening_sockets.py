"""Every listening TCP socket that this process and its children hold, as Linux shows them."""

import os
import threading
from pathlib import Path


def family(pid: str) -> list[str]:
    """A process and all below it."""
    children: list[str] = []
    for tasks in Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            children += tasks.read_text().split()
        except OSError:  # the thread has ended
            pass
    return [pid, *(p for c in children for p in family(c))]


def listening() -> tuple[list[str], int]:
    """The sockets, and how many processes were looked at."""
    lines = [
        line.split()
        for file in ("tcp", "tcp6")
        for line in Path(f"/proc/net/{file}").read_text().splitlines()[1:]
    ]
    inodes = {f"socket:[{line[9]}]" for line in lines if line[3] == "0A"}
    held, processes = [], family(str(os.getpid()))
    for pid in processes:
        for descriptor in Path(f"/proc/{pid}/fd").glob("*"):
            try:
                held.append(os.readlink(descriptor))
            except OSError:
                pass
    return [h for h in held if h in inodes], len(processes)


class Watch:
    """Looks twenty times a second, from a thread, at what is open."""

    def __init__(self) -> None:
        self.found: list[str] = []
        self.most_processes = 0
        self.looks = 0
        threading.Thread(target=self._look, daemon=True).start()

    def _look(self) -> None:
        pause = threading.Event()
        while True:
            sockets, processes = listening()
            self.found += sockets
            self.most_processes = max(self.most_processes, processes)
            self.looks += 1
            pause.wait(0.05)
