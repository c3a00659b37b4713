"""The command ``linkwatch``."""

from __future__ import annotations

import os
import re
import signal
import sys
import traceback
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from ._linkwatch import command

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Iterator
    from typing import Any

    from .io import Frame, Frames

# Sentence about elements that are not read: the file of a later frame, number, kind, first place.
SENTENCE = re.compile(r"(.*?: )?(\d+) (.+?) \((?:the first one: )?(.*)\)", re.DOTALL)

# Options of `io.read` that the command passes, in this order.
OPTIONS = "closed keep_open keep_order unwrap cell select format".split()


def main() -> int:
    """Runs the command with the arguments of the process, and returns its exit code."""
    try:
        return _main()
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as why:  # a panic is no Exception
        # The exit code of Python is 1, which is a verdict.
        traceback.print_exc()
        said = " ".join(f"{type(why).__name__}: {why}".split())
        print(f"error: {said}: please report this, with the lines above", file=sys.stderr)
        return 2


def _main() -> int:
    """Runs the command: see :func:`main`."""
    # Replaces a closed standard stream, whose descriptor the next opened file would get.
    for stream in range(3):
        try:
            os.fstat(stream)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    # Python's own handler would take effect only when the command has ended.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    reader = Reader()
    try:
        return command(["linkwatch", *sys.argv[1:]], reader)
    finally:
        if reader.folder is not None:
            reader.folder.cleanup()


class Reader:
    """Reads files of formats that the command does not know. The readers are imported when a file
    needs them."""

    def __init__(self) -> None:
        self.folder: TemporaryDirectory[str] | None = None
        self.remover: subprocess.Popen[bytes] | None = None
        #: Files in this folder with the contents of compressed ones.
        self.plain: dict[str, Path] = {}

    def reads(self, file: str) -> bool:
        """Returns if the package, but not the command itself, reads the file."""
        from . import io

        return io.format_of(Path(file)) is not io.FORMATS[-1]

    def groups(self, files: list[str], format: str | None) -> list[int]:
        """Divides files into groups that are read together, and returns their sizes."""
        from . import io

        return io.groups([self.unpacked(file) for file in files], format)

    def unpacked(self, file: str) -> Path:
        """Returns the content of a compressed file. Others are returned as they are."""
        import subprocess

        from . import io

        path = Path(file)
        if path.suffix.lower() not in io.COMPRESSED or not path.is_file():
            return path
        if self.folder is None:
            self.folder = TemporaryDirectory(prefix="linkwatch-")
            if os.name == "posix":
                # Removes the files also if this process is killed: its end closes the pipe.
                remove = ["sh", "-c", 'cat; rm -rf -- "$0"', self.folder.name]
                pipe = subprocess.PIPE
                self.remover = subprocess.Popen(remove, stdin=pipe, start_new_session=True)
        if file not in self.plain:
            self.plain[file] = io.unpacked([path], Path(self.folder.name))[0]
        return self.plain[file]

    def frames(
        self, files: list[str], one_motion: bool, options: tuple[Any, ...]
    ) -> Iterator[tuple[Frame, list[tuple[int, str, str]], list[str]]]:
        """Opens files that are read together, with the values of ``OPTIONS``. Yields each frame,
        the elements that are not read, and new notes about the files."""
        from . import io

        frames = io.read(*files, **dict(zip(OPTIONS, options)))
        if frames.runs > 1 and not one_motion:
            raise ValueError(
                f"{frames.runs} files have several frames each: check each of them alone, or give "
                "--one-motion if they continue one another"
            )
        return _read(frames)


def _read(frames: Frames) -> Iterator[tuple[Frame, list[tuple[int, str, str]], list[str]]]:
    """Yields frames: see :meth:`Reader.frames`."""
    summary = frames.summary
    said, known, left_out = 0, None, []
    for k, frame in enumerate(frames):
        notes = summary.notes[said:] if k else summary.lines()
        said = len(summary.notes)
        if frame.left_out != known:
            known = frame.left_out
            left_out = [_counted(sentence) for sentence in known]
        yield frame, left_out, notes


def _counted(sentence: str) -> tuple[int, str, str]:
    """Returns the number, the kind and the place of the first one of elements that are not read."""
    found = SENTENCE.fullmatch(sentence)
    if found is None:
        return 1, "element", sentence
    return int(found[2]), found[3], (found[1] or "") + found[4]
