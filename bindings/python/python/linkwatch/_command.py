"""The command ``linkwatch``."""

from __future__ import annotations

import os
import signal
import sys

from ._linkwatch import command


def main() -> int:
    """Runs the command with the arguments of the process, and returns its exit code."""
    # Files that are opened later must not become the standard streams.
    for stream in range(3):
        try:
            os.fstat(stream)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    # Python's own handler would take effect only when the command has ended.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    return command(["linkwatch", *sys.argv[1:]])
