"""How a process that a test starts meets the signals that end it."""

import signal

from strandcast.errors import ENDING_SIGNALS


def take_signals(hang_up: signal.Handlers = signal.SIG_DFL) -> None:
    """Let signals end a process that starts, as those of tests under nohup or in the background may not."""
    for number in ENDING_SIGNALS:
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGHUP, hang_up)
