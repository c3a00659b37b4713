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
    args = sys.argv[1:]
    if args[:1] == ["convert"] and (code := convert(args[1:])) is not None:
        return code
    return command(["linkwatch", *args])


def convert(args: list[str]) -> int | None:
    """Converts a file that only this package reads to ``.npz``, and returns the exit code.

    Returns ``None`` if no argument is such a file: the command itself converts all others.
    """
    from . import io

    if not any(arg.lower().endswith(tuple(io.READERS)) for arg in args[:-1]):
        return None
    import argparse

    what = "Converts a file to .npz, which all of the command reads."
    parser = argparse.ArgumentParser("linkwatch convert", description=what)
    parser.add_argument("input", metavar="IN", help=", ".join(io.READERS))
    parser.add_argument("output", metavar="OUT.npz")
    parser.add_argument("--force", action="store_true", help="overwrite existing files")
    given = parser.parse_args(args)
    try:
        frames = io.read(given.input)
        written = io.write(given.output, frames, force=given.force)
    except (ImportError, OSError, ValueError) as why:
        print(f"error: {why}", file=sys.stderr)
        return 2
    summary = frames.summary
    print(f"{given.input}: {summary}", file=sys.stderr)
    if len(written) > 1:
        names = " ".join(map(str, written))
        print(
            f"the curves or names change, so there are {len(written)} files: check them with "
            f"`linkwatch check {names} --one-motion`",
            file=sys.stderr,
        )
    return 3 if summary.left_out or summary.rejected else 0
