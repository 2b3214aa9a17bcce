"""A slow network that loses packets, between a driver and its stand-in, for TCP.

`tc netem` needs a kernel that has it; this relay shows what TCP makes of the same: each packet comes later,
and all that follow a lost one wait until it has been sent again.
"""

import multiprocessing
import queue
import random
import socket
import threading
import time
from contextlib import suppress
from multiprocessing.sharedctypes import Synchronized

AGAIN_S = 0.010  # from when the next packets show that one is lost until it is sent again; chosen


class Network:
    """A relay in a process of its own: what listens at `back` can be reached at `host`.

    `loss` is the share of packets that are lost, which can be set at any time.
    """

    def __init__(self, host: str, back: str, ports: tuple[int, ...], delay_s: float) -> None:
        context = multiprocessing.get_context("spawn")
        self.host, self.loss = host, context.Value("d", 0.0)
        ready = context.Event()
        given = (host, back, ports, delay_s, self.loss, ready)
        self._process = context.Process(target=relay, args=given, daemon=True)
        self._process.start()
        assert ready.wait(60)

    def end(self) -> None:
        """End it."""
        self._process.kill()
        self._process.join()


def relay(
    host: str,
    back: str,
    ports: tuple[int, ...],
    delay_s: float,
    loss: "Synchronized[float]",
    ready: threading.Event,
) -> None:
    """Relay connections to all ports."""

    def accept(server: socket.socket, port: int) -> None:
        while True:
            near, far = server.accept()[0], socket.create_connection((back, port))
            for number, (one, other) in enumerate(((near, far), (far, near))):
                one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                way = queue.SimpleQueue[tuple[float, bytes]]()
                lost = random.Random(f"{port} {number}")
                start(take, one, way, delay_s, loss, lost)
                start(give, other, way)

    for server, port in [(socket.create_server((host, port)), port) for port in ports]:
        start(accept, server, port)
    ready.set()
    threading.Event().wait()


def start(function: object, *arguments: object) -> None:
    """Start a thread."""
    threading.Thread(target=function, args=arguments, daemon=True).start()  # type: ignore[arg-type]


def take(
    link: socket.socket,
    way: "queue.SimpleQueue[tuple[float, bytes]]",
    delay_s: float,
    loss: "Synchronized[float]",
    lost: random.Random,
) -> None:
    """Put packets on their way, with the time at which each arrives."""
    arrives_s, packet = 0.0, b"..."
    while packet:
        packet = b""
        with suppress(OSError):
            packet = link.recv(65536)
        late_s = 2.0 * delay_s + AGAIN_S if lost.random() < loss.value else 0.0
        arrives_s = max(arrives_s, time.monotonic() + delay_s + late_s)
        way.put((arrives_s, packet))


def give(link: socket.socket, way: "queue.SimpleQueue[tuple[float, bytes]]") -> None:
    """Deliver packets, each at its time."""
    with suppress(OSError):
        while True:
            arrives_s, packet = way.get()
            time.sleep(max(0.0, arrives_s - time.monotonic()))
            if not packet:
                return link.shutdown(socket.SHUT_WR)
            link.sendall(packet)
