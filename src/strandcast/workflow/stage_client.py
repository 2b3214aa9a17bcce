"""Runs a command of strandcast in a fork of the stage server: `python -IS stage_client.py SERVER COMMAND …`.

It behaves as the command would here: same output, exit code and signals. Without a server that takes the
command, it becomes `python -m strandcast COMMAND …`. It starts for every job of the workflow, so it imports
next to nothing: no module of this package, and `_socket`, as `socket` takes as long as Python's own start.
"""

import _signal  # type: ignore[import-not-found]  # as `signal`, which imports more
import _socket
import os
import sys

ENDING = (_signal.SIGINT, _signal.SIGTERM, _signal.SIGHUP)
CREDENTIALS_BYTES = 12  # of the server's process: its id, its user, its group
NUMBER_BYTES = 4  # of every number that is sent


def main(server: str, arguments: list[str]) -> None:
    """Run a command by a server, or here, and end as it ends."""
    heeded = [number for number in ENDING if _signal.getsignal(number) != _signal.SIG_IGN]
    for number in heeded:
        _signal.signal(number, _signal.SIG_DFL)
    code = _served(server, arguments, heeded)
    if code is None:
        os.execv(sys.executable, [sys.executable, "-m", "strandcast", *arguments])
    if code < 0:  # a signal ended it
        if -code not in (_signal.SIGKILL, _signal.SIGSTOP):
            _signal.signal(-code, _signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    os._exit(code)


def _served(server: str, arguments: list[str], heeded: list[int]) -> int | None:
    """Return the exit code, negative for a signal; None if no server has run the command to its end."""
    connection = _socket.socket(_socket.AF_UNIX, _socket.SOCK_STREAM)
    try:
        connection.connect(b"\0" + server.encode())
        credentials = connection.getsockopt(_socket.SOL_SOCKET, _socket.SO_PEERCRED, CREDENTIALS_BYTES)
        if _number(credentials[NUMBER_BYTES : 2 * NUMBER_BYTES]) != os.getuid():
            return None
        folder = os.getcwd()  # noqa: PTH109  # pathlib takes as long as all the rest
        words = map(os.fsencode, (folder, str(len(arguments)), *arguments))
        environment = (name + b"=" + value for name, value in os.environb.items())
        request = b"\0".join((*words, *environment))
        streams = b"".join(map(_bytes, (0, 1, 2)))
        connection.sendmsg([_bytes(len(request))], [(_socket.SOL_SOCKET, _socket.SCM_RIGHTS, streams)])
        connection.sendall(request)
        for number in heeded:
            _signal.signal(number, lambda number, _: _pass_on(connection, number))
        answer = connection.recv(NUMBER_BYTES, _socket.MSG_WAITALL)
    except OSError:
        return None
    return _number(answer) if len(answer) == NUMBER_BYTES else None


def _pass_on(connection: _socket.socket, number: int) -> None:
    try:  # noqa: SIM105  # no contextlib
        connection.send(bytes((number,)))
    except OSError:  # the command has ended
        pass


def _bytes(number: int) -> bytes:
    return number.to_bytes(NUMBER_BYTES, sys.byteorder, signed=True)


def _number(data: bytes) -> int:
    return int.from_bytes(data, sys.byteorder, signed=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
