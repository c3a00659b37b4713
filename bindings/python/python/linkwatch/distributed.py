"""Verification on many machines, or many processes of one, by Dask or ``concurrent.futures``.

:func:`linkwatch.check` with a ``client`` verifies chunks of one run at the same time, and
:func:`check_many` many runs. The client is a ``dask.distributed.Client``, or an ``Executor`` of
``concurrent.futures``:

>>> from concurrent.futures import ThreadPoolExecutor
>>> import linkwatch
>>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
>>> frames = [[ring, [[x, 0, -1], [x + 2, 0, -1], [x + 2, 0, 1], [x, 0, 1]]] for x in (0, 0.5, 4)]
>>> with ThreadPoolExecutor(2) as client:
...     print(linkwatch.check(frames, client=client, chunk=1).verdict)
changed

**The result is that of one machine**, finding by finding. A chunk begins with the last frame of the
previous one, so that the step between them is searched for pull-throughs, and with the state of the
session after the first frame of the run. Once the previous chunk has ended, its state is compared
with that; if later findings may depend on the difference, the chunk is verified again from that
state. This happens after linking numbers were added to the baseline, curves came or went, or a
curve jumped by a lattice vector: from there on, chunks are verified one after the other. The lower
bound of a clearance may differ, and in a periodic cell the digits of places in words.

Trajectories of MDAnalysis and files of the command (``.npz`` and others) are read by the workers,
which need the files under the same names. Frames of all others are read here and sent to them.
Each worker reads a file of the command from its beginning, so it reads on from chunk to chunk.

Dask verifies the chunk of a worker that was lost again on another one. A process that was forked
from one that used linkwatch cannot use it: processes of ``ProcessPoolExecutor`` are best spawned.
Every process uses all cores unless ``RAYON_NUM_THREADS`` says otherwise.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import os
import pickle
import threading
import warnings
from collections import deque
from typing import TYPE_CHECKING

from ._run import Checker, Run, bar, check

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from typing import Any

    from .io import Frame, Frames

__all__ = ["check_many"]

#: Bytes of the positions of a chunk that is sent to a worker, if its size is not given.
SENT = 1 << 26

_opened = threading.local()


def verify(run: Run, client: Any, chunk: int | None, progress: bool | None) -> None:
    """Verifies the frames of a run by a client, and adds them to it."""
    source = run.source
    assert source is not None
    if not hasattr(client, "submit"):
        raise TypeError(f"client is {client!r}, expected one of Dask, or an Executor")
    submit, workers = _submit(client), _workers(client)
    if chunk is not None and chunk < 1:
        raise ValueError(f"chunk is {chunk}, expected at least 1 frame")
    by_workers = source.part is not None and source.recipe is not None
    parts = _parts(source, chunk, workers) if by_workers else _sent(source, chunk)
    first = next(parts, None)
    if first is None:
        return
    # The state after the first frame. Workers of Dask fetch it from one another, and compute it
    # again if a worker that had it is lost.
    begin = submit(_begin, first, run.options)
    begin = begin if _is_dask(client) else begin.result()
    waiting: deque[tuple[Any, Any]] = deque()

    def send() -> None:
        """Sends the next chunk to a worker."""
        if (part := next(parts, None)) is not None:
            waiting.append((part, submit(_verify, part, run.options, begin, True)))

    waiting.append((first, submit(_verify, first, run.options, None, False)))
    for _ in range(2 * workers):
        send()
    parts_so_far = Parts(run)
    shown = bar((), source.length, progress, " frames")
    try:
        while waiting:
            part, future = waiting.popleft()
            frames = len(run.frames)
            parts_so_far.add(
                future.result(),
                lambda state: submit(_verify, part, run.options, state, False).result(),
            )
            if hasattr(shown, "update"):
                shown.update(len(run.frames) - frames)
            send()
    finally:
        for _, future in waiting:
            future.cancel()
        if hasattr(shown, "close"):
            shown.close()


class Parts:
    """The parts of a run that were merged so far, and the state after them."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.state: Any = None
        self.number: Any = None

    def add(self, result: Any, again: Callable[[Any], Any]) -> None:
        """Adds the result of :func:`_verify` for the next part. ``again`` verifies the part from a
        state on, if the result is that of another one.
        """
        found, assumed, after, later = result
        if self.state is not None and assumed != self.number:
            found, _, after, later = again(self.state)
        self.state, self.number = after, later
        self.run._merge(found)


def _is_dask(client: Any) -> bool:
    return hasattr(client, "scheduler_info")


def _submit(client: Any) -> Callable[..., Any]:
    """Returns the function that sends a call to a worker."""
    if not _is_dask(client):
        submit: Callable[..., Any] = client.submit
        return submit

    def submit_to_dask(*call: Any) -> Any:
        with warnings.catch_warnings():
            # Frames that a lost worker had are sent again, which scattered ones are not.
            warnings.filterwarnings("ignore", "Sending large graph")
            # Dask would look for an earlier result of the same arguments, which are large.
            return client.submit(*call, pure=False)

    return submit_to_dask


def _workers(client: Any) -> int:
    """Returns the number of calls that the client runs at the same time."""
    if hasattr(client, "nthreads"):
        return max(1, sum(map(int, client.nthreads().values())))
    return int(getattr(client, "_max_workers", 0) or os.cpu_count() or 1)


def _parts(source: Frames, chunk: int | None, workers: int) -> Iterator[Any]:
    """Yields chunks that workers read: the recipe of the frames, and the numbers of some."""
    # The number tells this check from an earlier one, after which files may have changed.
    frames, recipe = len(source), pickle.dumps((source, os.urandom(8)))
    # Chunks of seconds, so that a scheduler that takes 15 ms for a chunk keeps 1000 workers busy.
    chunk = chunk or min(max(-(-frames // (4 * workers)), 16), 8192)
    for start in range(0, frames, chunk):
        yield recipe, max(start - 1, 0), min(start + chunk, frames)


def _sent(source: Frames, chunk: int | None) -> Iterator[Any]:
    """Yields chunks of frames that are read here."""
    frames = map(_copied, source)
    overlap: list[Frame] = []
    for first in frames:
        rest = (chunk or min(max(SENT // max(first.positions.nbytes, 1), 4), 1024)) - 1
        part = [*overlap, first, *itertools.islice(frames, rest)]
        overlap = part[-1:]
        yield part


def _copied(frame: Frame) -> Frame:
    """Copies the points of a frame, because a simulation may overwrite them."""
    return dataclasses.replace(frame, positions=frame.positions.copy())


def _frames(part: Any) -> Iterable[Frame]:
    """Returns the frames of a chunk on a worker. Each of its threads opens a file once."""
    if not isinstance(part, tuple):
        return part  # type: ignore[no-any-return]
    recipe, start, stop = part
    if getattr(_opened, "recipe", None) != recipe:
        _opened.recipe, (_opened.frames, _) = recipe, pickle.loads(recipe)
    frames: Iterable[Frame] = _opened.frames.part(start, stop)
    return frames


def _begin(part: Any, options: dict[str, Any]) -> Any:
    """Returns the state of a session after the first frame that is not rejected."""
    checker = Checker(Run(None, options))
    for frame in _frames(part):
        if checker.step(frame).rejected is None:
            break
    return checker.state()[0]


def _verify(part: Any, options: dict[str, Any], state: Any, assumed: bool) -> Any:
    """Verifies a chunk. Returns its run, a hash of the state before it if that is assumed, and the
    state after it with its hash. With a state, the first frame belongs to the previous chunk.
    """
    checker = Checker(Run(None, options), state)
    frames = iter(_frames(part))
    before = None
    try:
        if state is not None:
            first = next(frames)
            if assumed and checker.step(first, begins_part=True).rejected is None:
                before = checker.state()[1]
        checker.verify(frames)
    except ValueError:
        if not assumed:
            raise
        # The chunk is verified again, from the state after the previous one.
        return None, None, None, None
    return checker.run, before, *checker.state()


def check_many(
    paths: Sequence[Any], client: Any, *, progress: bool | None = None, **options: Any
) -> list[Run]:
    """Verifies many runs, each one by one worker.

    >>> from concurrent.futures import ThreadPoolExecutor
    >>> from tempfile import TemporaryDirectory
    >>> import linkwatch
    >>> import numpy as np
    >>> rings = np.concatenate([np.eye(3), np.eye(3) + 0.3])
    >>> frames = [linkwatch.io.Frame(rings, [-3, -3], seq=k) for k in range(2)]
    >>> with TemporaryDirectory() as folder, ThreadPoolExecutor(2) as client:
    ...     paths = [linkwatch.write(frames, f"{folder}/{name}.npz")[0] for name in "ab"]
    ...     [run.verdict for run in linkwatch.distributed.check_many(paths, client)]
    ['intact', 'intact']

    Args:
        paths: a path for each run, or a list of the paths that :func:`linkwatch.read` takes
            together. Workers need the files under the same names.
        client: as of :func:`linkwatch.check`.
        progress: whether to show a progress bar.
        options: those of :func:`linkwatch.check`.

    Returns:
        list[Run]: in the order of the paths.

    Raises:
        OSError, ValueError: a file cannot be read. Those of the other runs are cancelled.
    """
    submit = _submit(client)
    call = functools.partial(check, progress=False, **options)
    futures = [submit(call, path) for path in paths]
    try:
        return [future.result() for future in bar(futures, len(futures), progress, " runs")]
    finally:
        for future in futures:
            future.cancel()
