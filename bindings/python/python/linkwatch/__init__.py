"""Verifies the topology of simulations of yarn, chainmail, rods, ring polymers and other curves.

check(frames)          verifies a run: a file, a universe of MDAnalysis, or arrays; tables and plots
read, write            frames of files of other programs; ``linkwatch.io`` has the formats
Session().step(frame)  verifies a simulation in this process, frame by frame
Client                 publishes frames to the command ``linkwatch watch``, beside the simulation
assert_intact(frames)  in a test of a simulation
certify(frame)         all linking numbers of a frame: a Certificate, which can be a baseline
pull_throughs, safe_fraction                         the step between two frames
thickness, struts, ribbon                            shape of the curves of a frame
diagram, identify                                    knots and links: PD code, invariants, names
linking, writhe, twist, gauss_integrals, thickness   of all frames of a run, as arrays
distributed            runs on many machines; ``check(frames, client=..)`` is its short form

A *frame* is a list of curves. All functions take frames in one of two forms:

- a sequence of arrays of the shape ``(n, 3)``, one for each curve, and ``closed``: one boolean, or
  one for each curve (by default, all are closed);
- one array of the shape ``(N, 3)`` and ``counts``, the number of points of each curve, negative if
  the curve is closed. This form is not copied if it is contiguous.

Coordinates are ``float32`` or ``float64``, and are verified in the precision that they have.
A curve that is open and ends where it starts, up to rounding, is closed, without the repeated
point; a curve that is closed by default stays open if its closing segment is more than twice as
long as the longest other one. Both are a :class:`ClosingWarning`. ``basis`` is ``"polyline"``,
``"catmull-rom"``, ``"b-spline"`` or ``"bezier"``.

``cell`` is the periodic cell of a scene that repeats, such as a melt in a box or a unit cell of a
fabric: the three edges along the axes (0 for a direction without repetition), three vectors (an
array of the shape ``(3, 3)``), or these and a corner (``(4, 3)``); also as 9 or 12 numbers. Each
curve then stands for all its images, and its points may lie outside the cell; they are not wrapped
into it. Findings have the ``image`` of the second curve: its translation, in lattice vectors.

>>> import linkwatch
>>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
>>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
>>> linkwatch.certify([ring, other]).links
[(0, 1, -1)]
"""

from __future__ import annotations

import re
import sys
import warnings
import weakref
from typing import TYPE_CHECKING, overload

from . import _arguments as arguments
from ._linkwatch import Certificate, Message
from ._linkwatch import Client as _Client
from ._linkwatch import Session as _Session
from ._linkwatch import __version__
from ._linkwatch import certify as _certify
from ._linkwatch import decided_counts as _decided_counts
from ._linkwatch import diagram as _diagram
from ._linkwatch import ribbon as _ribbon
from ._linkwatch import struts as _struts
from ._linkwatch import thickness as _thickness
from ._results import Change, Clearance, Defect, Diagram, InvariantChange, Place, PullThrough
from ._results import Report, Ribbon, Strut, Thickness

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Iterator, Sequence
    from types import TracebackType
    from typing import Any

    import numpy as np
    import numpy.typing as npt

    from . import distributed as distributed
    from . import io as io
    from . import mdanalysis as mdanalysis
    from ._run import Run as Run
    from ._run import check as check
    from ._series import gauss_integrals as gauss_integrals
    from ._series import linking as linking
    from ._series import twist as twist
    from ._series import writhe as writhe
    from .io import read as read
    from .io import write as write
    from ._arguments import Cell, Closed, Counts, Frame

__all__ = [
    "Certificate",
    "Change",
    "Clearance",
    "Client",
    "ClosingWarning",
    "Defect",
    "Diagram",
    "InvariantChange",
    "Message",
    "Place",
    "PullThrough",
    "Report",
    "Ribbon",
    "Run",
    "Session",
    "Strut",
    "Thickness",
    "UndecidedError",
    "UnverifiedWarning",
    "assert_intact",
    "certify",
    "check",
    "diagram",
    "distributed",
    "gauss_integrals",
    "identify",
    "io",
    "linking",
    "pull_throughs",
    "read",
    "ribbon",
    "safe_fraction",
    "struts",
    "thickness",
    "twist",
    "write",
    "writhe",
]


class UndecidedError(Exception):
    """It cannot be decided what happened: curves touch, or are too close.

    >>> import linkwatch
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
    >>> touching = [[1, 0, -1], [3, 0, -1], [3, 0, 1], [1, 0, 1]]
    >>> try:
    ...     linkwatch.pull_throughs([ring, other], [ring, touching])
    ... except linkwatch.UndecidedError as why:
    ...     print(why)
    curves 0 and 1 touch, near (1.00000, 0.00000, 0.00000), segments 1 and 3, 0 apart
    """


class UnverifiedWarning(UserWarning):
    """Something is not verified: curves that are open or may be torn at the boundary of the cell,
    pairs that ``Certificate.compare`` cannot compare, or the clearance of strands.

    >>> import linkwatch
    >>> import warnings
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> with warnings.catch_warnings(record=True) as said:
    ...     _ = linkwatch.certify([ring, [[0, 0, 5], [9, 0, 5]]], closed=[True, False])
    >>> print(said[0].message)
    1 of 2 curves is open and has no linking numbers: 1
    """


class ClosingWarning(UserWarning):
    """Points decided which curves are closed: those that end where they start, for example.

    >>> import linkwatch
    >>> import warnings
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> with warnings.catch_warnings(record=True) as said:
    ...     _ = linkwatch.certify([ring, [[x, y, z + 5] for x, y, z in ring + ring[:1]]])
    >>> said[0].category
    <class 'linkwatch.ClosingWarning'>
    """


def _warn_of_closing(notes: list[str], level: int = 3) -> None:
    """Warns of decisions, in the name of the caller of the function that calls this one."""
    for note in notes:
        warnings.warn(note, ClosingWarning, stacklevel=level)


def _warn_of_open(open: list[int], curves: int) -> None:
    """Warns of open curves, in the name of the caller of the function that calls this one."""
    if open:
        some = ", ".join(map(str, open[:5])) + (", .." if len(open) > 5 else "")
        are = "is open and has" if len(open) == 1 else "are open and have"
        what = f"{len(open)} of {curves} curves {are} no linking numbers: {some}"
        warnings.warn(what, UnverifiedWarning, stacklevel=3)


class Session:
    """Verifies the frames of one simulation, in this process.

    >>> import linkwatch
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
    >>> session = linkwatch.Session(names=["ring", "other"])
    >>> session.step([ring, other]).intact  # the first frame is the baseline
    True
    >>> session.describe(names=["other"])
    >>> session.step([other]).gone
    ['ring']

    A frame is verified completely, or rejected: then it leaves no trace in the results of later
    frames. Threads may share a session: their calls take turns.

    Args:
        counts: number of points of each curve, negative if the curve is closed, if frames are
            single arrays.
        closed: whether curves are closed, if frames are sequences of arrays; by default, all are.
        names: name of each curve. Findings then name the curves, and curves may come and go
            (:meth:`describe`).
        basis: rule that turns points into curves.
        baseline: expected linking numbers; by default those of the first frame.
        events: pull-throughs to search for from frame to frame: ``"between"`` different curves,
            ``"all"`` (also of a curve through itself) or ``"off"``.
        abort_on: findings that set ``Report.abort``: ``"any"``, ``"lost"``, ``"gained"``,
            ``"contact"``, ``"event"``, ``"rejected"``, ``"clearance"`` (any, or strands that come
            too close) or ``"never"``.
        incremental: compute only linking numbers that may have changed. The verdicts are the same.
        motion_limit: motion between two frames, in segment lengths, up to which pull-throughs that
            cancel count as real.
        invariants: what is compared beside linking numbers: ``"self"`` (``v2``, ``v3`` and the
            determinant of each closed curve: its knot), ``"triple"`` (Milnor's triple linking
            numbers) or ``"self,triple"``; by default nothing, or that of the baseline.
        radius: radius of the strands, or of each curve, in the units of the points:
            ``Report.clearance`` says how close they come.
        min_clearance: distance of centre lines, as a share of the sum of the radii, below which
            ``Report.clearance.low`` is set; by default 0.5. Needs ``radius``.
        cell: periodic cell of the frames; :meth:`step` changes it.
        wrapped: True if coordinates are wrapped into the cell, so that curves are unwrapped; False
            if they are unwrapped, and taken as they are. By default, curves are whole, and followed
            if they jump by a lattice vector (:attr:`jumps`).
        keep_open: keep curves open that end where they start. By default, they are closed, without
            the repeated point.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: an option has an invalid value, or has no effect.
        RuntimeError: this process was forked from one that used linkwatch, whose threads it does
            not have.
    """

    def __init__(
        self,
        counts: Counts | None = None,
        *,
        closed: Closed | None = None,
        names: Sequence[str] = (),
        basis: str = "polyline",
        baseline: Certificate | None = None,
        events: str = "between",
        abort_on: str = "any",
        incremental: bool = True,
        motion_limit: float | None = None,
        invariants: str = "",
        radius: float | Sequence[float] | npt.NDArray[Any] | None = None,
        min_clearance: float | None = None,
        cell: Cell | None = None,
        wrapped: bool | None = None,
        keep_open: bool = False,
        _state: bytes | None = None,
    ) -> None:
        strands: tuple[float | None, float] | None = None
        radii: Sequence[float] | npt.NDArray[Any] = ()
        if radius is not None:
            import numpy as np

            low = 0.5 if min_clearance is None else arguments.number("min_clearance", min_clearance)
            if np.ndim(radius) == 0:
                expected = "a radius, or one for each curve"
                strands = (arguments.number("radius", radius, expected), low)
            else:
                strands = (None, low)
                radii = arguments.numbers("radius", radius)
        elif min_clearance is not None:
            raise ValueError("min_clearance has no effect without radius")
        if baseline is not None and not isinstance(baseline, Certificate):
            kind = type(baseline).__name__
            expected = "expected a Certificate: that of certify, or Certificate.read(path)"
            raise TypeError(f"baseline is a {kind}, {expected}")
        if motion_limit is not None:
            motion_limit = arguments.number("motion_limit", motion_limit)
        vectors = None if cell is None else arguments.twelve(cell)
        self._session = _Session(
            words=(
                arguments.word("basis", basis, BASES),
                arguments.word("events", events, "'between', 'all' or 'off'"),
                arguments.word("abort_on", abort_on, "'any', 'lost', .. or 'never'"),
                arguments.word("invariants", invariants, "'self', 'triple' or 'self,triple'"),
            ),
            baseline=baseline,
            flags=(
                arguments.flag("incremental", incremental),
                arguments.flag("keep_open", keep_open),
                None if wrapped is None else arguments.flag("wrapped", wrapped),
            ),
            motion_limit=motion_limit,
            strands=strands,
            state=_state,
        )
        self._counts: list[int] | None = None
        self._closed: Closed | None = None
        self._searches = events != "off"
        self._clearance = strands is not None
        self._unmeasured: str | None = None
        if _state is None:
            self.describe(counts, closed=closed, names=names, radii=radii)
        if vectors is not None:
            self._session.set_cell(vectors)

    def describe(
        self,
        counts: Counts | None = None,
        *,
        closed: Closed | None = None,
        names: Sequence[str] = (),
        radii: Sequence[float] | npt.NDArray[Any] = (),
    ) -> None:
        """Describes other curves from the next frame on.

        Curves may be added, removed, reordered, or get another number of points. Linking numbers of
        curves are compared by their names, and those of new curves are expected to stay as they are
        in their first frame. Pull-throughs are searched for among the curves that keep their name
        and number of points. A frame is undecided if a curve cannot be compared with the
        frames before: see "Names and radii" in the book. A name belongs to one curve for the whole
        session.
        ``Report.appeared`` and ``Report.gone`` list the names of curves that come and go.

        Without names, curves cannot be compared: after the first frame, frames are rejected until
        the baseline is a new one (:meth:`accept`). In a periodic cell, the curves must stay the
        same, but may be named or get other radii.

        Args:
            counts, closed: as of :class:`Session`; by default, they stay as they are.
            names: name of each curve, 1 to 255 bytes.
            radii: radius of each curve, in the units of the points, if ``radius`` has one for
                each curve.

        Raises:
            TypeError: an argument has the wrong type.
            ValueError: two curves have the same name, a name or a radius is invalid, or radii are
                missing or have no effect. The description stays as it was.
        """
        known = self._counts if counts is None else arguments.integers(counts)
        closed = self._closed if closed is None else closed
        labels = arguments.words("names", names), arguments.numbers("radii", radii)
        self._session.describe(*labels, known is None and closed is None)
        self._counts, self._closed = known, closed
        # Without a search for pull-throughs, open curves are not verified at all.
        self._warn_of_open = not self._searches

    def step(self, curves: Frame, time: float = 0.0, *, cell: Cell | None = None) -> Report:
        """Verifies the next frame, at ``time`` seconds, and returns its :class:`Report`.

        ``cell`` is the periodic cell from this frame on (also if the frame is rejected), if it is
        another one than before. All frames of a session repeat along the same directions, or along
        none.

        Other threads of Python run meanwhile. A frame that breaks its contract (NaN, other curves
        than described, a cell that repeats along other directions) has the verdict ``"rejected"``.

        The report is true if the frame is intact: ``if not session.step(x): break``. Open curves
        are not verified without ``events``, which is an :class:`UnverifiedWarning`. So is a
        clearance that cannot be measured: that of later frames is not measured either.

        Raises:
            TypeError: an argument has the wrong type.
            ValueError: the frame does not have one of the two forms; the cell is no lattice; the
                first frame does not fit the baseline, or has no closed curve and there are no
                ``events``.
        """
        points, counts = arguments.frame(curves, self._counts, self._closed)
        time = arguments.number("time", time)
        if cell is not None:
            self._session.set_cell(arguments.twelve(cell))
        report = self._session.step(points, counts, time)
        _warn_of_closing(self._session.notes())
        if self._warn_of_open and report.rejected is None:
            self._warn_of_open = False
            _warn_of_open(self._session.open(), len(counts))
        if self._clearance and (why := self._session.unmeasured_clearance()) != self._unmeasured:
            self._unmeasured = why
            if why is not None:
                what = f"clearance is not measured from frame {report.seq} on: {why}"
                warnings.warn(what, UnverifiedWarning, stacklevel=2)
        return report

    def accept(self) -> None:
        """Accepts the present state as the new baseline.

        The linking numbers of the next frame that is not rejected are expected from then on,
        whatever they are. Pull-throughs are not searched for in the step to it. Before the first
        frame, this does nothing: a given baseline remains.
        """
        self._session.accept()

    def cut(self) -> None:
        """Marks the next frame as not continuing the previous one: after a roll back or a jump."""
        self._session.cut()

    def close(self) -> None:
        """Frees the memory of the session, which cannot be used any more. At the end of a ``with``
        block as well.
        """
        self._session.close()

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def baseline(self) -> Certificate | None:
        """Expected linking numbers (:class:`Certificate`), or ``None`` before the first frame."""
        return self._session.baseline()

    @property
    def jumps(self) -> int:
        """Returns how many times a curve jumped by a lattice vector, and was followed."""
        return self._session.jumps()


#: The last client of this process on each service.
_clients: weakref.WeakValueDictionary[str, Client] = weakref.WeakValueDictionary()

BASES = "'polyline', 'catmull-rom', 'b-spline' or 'bezier'"


class Client:
    """Simulator's end of the bus: publishes frames to ``linkwatch watch``, and reads its verdicts.

    >>> with linkwatch.Client("linkwatch", counts=[-100, -100]) as sim:  # doctest: +SKIP
    ...     for step in range(1000):
    ...         sim.begin(time=step * 1e-3)[:] = x  # (200, 3), written where the watcher reads it
    ...         sim.publish()
    ...         if sim.aborted:
    ...             break
    >>> print(sim.aborted)  # doctest: +SKIP
    None

    ``aborted`` names the curves, the place and the state to roll back to, also for the last frames.

    Only :meth:`wait`, :meth:`wait_for_watcher` and :meth:`finish` wait for the watcher. A watcher
    that is slow, stopped, killed or absent costs the simulator nothing. At the end of the ``with``
    block the session ends: regularly, with :meth:`finish`, or early if the block raised an
    exception. In a notebook or an interactive interpreter, a client ends the session of the
    previous one with the same name, so that a cell can be run again. Threads may share a client:
    their calls take turns, also during a wait. A process that was forked from the one that opened
    the client cannot use it.

    Args:
        service: the name given to ``linkwatch watch --service``.
        counts: number of points of each curve, negative if the curve is closed.
        names: name of each curve. Curves with names can be described again (:meth:`describe`).
        radii: radius of each curve, in the units of the points, for the recording and for
            ``linkwatch watch --radius published``.
        time_step: time step of the simulator in seconds, for the recording; 0 if unknown.
        cell: periodic cell of the frames; :meth:`publish` changes it.
        dtype: type of the points: ``float64``, or ``float32``, which halves the memory; what is
            written to the array of :meth:`begin` is rounded to it.
        basis: rule that turns points into curves.
        lockstep: the simulator waits for the verdict on every frame; the watcher is informed.
        wait_mode: ``"sleep"``, or ``"spin"``: 10 to 50 microseconds faster, and keeps a core busy.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: an argument is invalid.
        RuntimeError: this process was forked from the one that opened the client (all calls).
        ConnectionError: another living simulator publishes on the same name.
    """

    def __init__(
        self,
        service: str = "linkwatch",
        *,
        counts: Counts,
        names: Sequence[str] = (),
        radii: Sequence[float] | npt.NDArray[Any] = (),
        time_step: float = 0.0,
        cell: Cell | None = None,
        dtype: npt.DTypeLike = "float64",
        basis: str = "polyline",
        lockstep: bool = False,
        wait_mode: str = "sleep",
    ) -> None:
        import numpy as np

        try:
            kind = np.dtype(dtype)
        except TypeError as why:
            raise TypeError(f"dtype: {why}; expected float32 or float64") from None
        if kind not in (np.float32, np.float64):
            raise ValueError(f"dtype is {kind}, expected float32 or float64")
        vectors = None if cell is None else arguments.twelve(cell)
        time_step = arguments.number("time_step", time_step, "a number of seconds")
        before = _clients.get(arguments.word("service", service, "the name of a service"))
        if before is not None and hasattr(sys, "ps1"):
            before._client.close()
        self._unanswered = False
        self._client: _Client = _Client(
            service,
            _curves(counts, names, radii),
            arguments.word("basis", basis, BASES),
            kind == np.float32,
            arguments.flag("lockstep", lockstep),
            arguments.word("wait_mode", wait_mode, "'sleep' or 'spin'"),
        )
        _clients[service] = self
        self._client.set_time_step(time_step)
        if vectors is not None:
            self._client.set_cell(vectors)

    def describe(
        self,
        counts: Counts,
        *,
        names: Sequence[str],
        radii: Sequence[float] | npt.NDArray[Any] = (),
    ) -> None:
        """Declares other curves from the next frame on.

        Curves may be added, removed, reordered, or get another number of points. The watcher
        compares the linking numbers of curves by their names, and expects those of new curves to
        stay as they are in their first frame. It searches for pull-throughs among the curves that
        keep their name and number of points. A frame is undecided if a curve cannot be
        compared with the frames before: see "Names and radii" in the book. A name belongs to one
        curve for the whole session.

        Raises:
            ValueError: an argument is invalid, or arrays of the frames of too many earlier
                descriptions are still in use.
            ConnectionError: curves without names change after the first frame.
        """
        self._client.describe(_curves(counts, names, radii))

    def set_time_step(self, seconds: float) -> None:
        """Sets the time step of the simulator, which later frames carry to the recording."""
        self._client.set_time_step(arguments.number("seconds", seconds))

    def begin(self, time: float = 0.0) -> npt.NDArray[Any]:
        """Returns the points of the next frame, at ``time`` seconds: an array ``(N, 3)``.

        It is a view of shared memory. Write all of it, then call :meth:`publish`; nothing is
        copied. Afterwards it is read-only, and later frames overwrite it. Do not write through
        slices or reshapes of it either, which would change a frame while it is verified.
        """
        return self._client.begin(arguments.number("time", time))

    def publish(self, *, cell: Cell | None = None) -> int:
        """Publishes the frame that was begun, and returns its number. Never waits.

        ``cell`` is the periodic cell from this frame on, if it is another one than before. All
        frames of a session repeat along the same directions, or along none.

        Raises:
            ValueError: the cell is no lattice. The frame is not published.
            RuntimeError: no frame was begun, or the session has ended.
        """
        if cell is not None:
            self._client.set_cell(arguments.twelve(cell))
        return self._client.publish()

    def poll(self) -> Message | None:
        """Returns the next verdict, in the order of the frames, or ``None``. Never waits."""
        return self._client.poll()

    def wait(self, seconds: float = 10.0, seq: int | None = None) -> Message | None:
        """Waits for the verdict on the last published frame, or on the frame ``seq``.

        Verdicts on earlier frames are read meanwhile.

        Returns:
            Message | None: ``None`` if there is no verdict in time, if the frame was skipped, or if
            the watcher left or died (:attr:`no_verdict` says which). The frame is not known to be
            intact then.

        Raises:
            ValueError: ``seq`` is negative or above 2**64 - 1.
        """
        if seq is not None and not 0 <= seq < 1 << 64:
            raise ValueError(f"seq is {seq}, expected the number of a published frame, from 0 on")
        return self._client.wait(arguments.number("seconds", seconds), seq)

    async def verdict(self, seq: int | None = None, seconds: float = 10.0) -> Message | None:
        """Waits as :meth:`wait` does, while other tasks of ``asyncio`` run.

        A task that is cancelled ends at once, but reads verdicts until the time is over.
        """
        import asyncio

        return await asyncio.to_thread(self.wait, seconds, seq)

    @property
    def no_verdict(self) -> str | None:
        """Why the last :meth:`wait` returned ``None``, as a sentence; ``None`` if it did not.

        After :meth:`finish` returned ``None``: why the watcher left, or that none answered.
        """
        why = self._client.no_verdict
        return "no watcher answered" if why is None and self._unanswered else why

    def wait_for_watcher(self, seconds: float = 10.0) -> bool:
        """Waits until a watcher has seen this session. Returns False if none came in time.

        Needed only if no frame must be missed: a watcher that starts later receives the first
        frame, which the client keeps, and then the newest one.
        """
        return self._client.wait_for_watcher(arguments.number("seconds", seconds))

    @property
    def aborted(self) -> Message | None:
        """The first verdict that asks the simulator to stop, or ``None``. Reads all verdicts.

        After the session: the last message if it asks the simulator to stop. Verdicts on the last
        frames may arrive only at the end.
        """
        return self._client.aborted()

    def resume(self) -> None:
        """Clears the abort after a roll back: the next frame does not continue the last one."""
        self._client.resume()

    def accept(self) -> None:
        """Accepts the present state as the new baseline, and clears the abort.

        The watcher expects the linking numbers of the next frame from then on, whatever they are.
        """
        self._client.accept()

    def cut(self) -> None:
        """Marks the next frame as not continuing the previous one, for example after a jump."""
        self._client.cut()

    @property
    def silent_for(self) -> float | None:
        """Seconds since the last message of the watcher; ``None`` if there is no watcher.

        A message comes about once a second. The simulator decides what a longer silence means.
        """
        return self._client.silent_for()

    def finish(self, seconds: float = 10.0) -> Message | None:
        """Ends the session, and waits until the watcher has verified its remaining frames.

        Returns:
            Message | None: the last message, which repeats the last abort; ``None`` if there is no
            watcher, or if it sent nothing in time.
        """
        last = self._client.finish(arguments.number("seconds", seconds))
        self._unanswered = last is None
        return last

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None and self._client.is_open:
            self._client.aborted()  # reads all messages
            # A watcher that connects only now needs a few milliseconds.
            self.finish(10.0 if self.silent_for is not None else 0.5)
        self._client.close()


def _curves(
    counts: Counts, names: Sequence[str], radii: Sequence[float] | npt.NDArray[Any]
) -> tuple[list[int], list[str], list[float]]:
    """Returns the description of curves for a client."""
    described = arguments.integers(counts), arguments.words("names", names)
    return *described, arguments.numbers("radii", radii)


def certify(
    curves: Frame,
    counts: Counts | None = None,
    *,
    closed: Closed | None = None,
    basis: str = "polyline",
    cell: Cell | None = None,
) -> Certificate:
    """Computes the linking numbers of all pairs of closed curves, exactly.

    >>> import linkwatch
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> other = [[8, 0, -1], [10, 0, -1], [10, 0, 1], [8, 0, 1]]
    >>> linkwatch.certify([ring, other], cell=[10, 10, 10]).images  # across the boundary
    [(0, 1, (-1, 0, 0), 1)]

    Returns:
        Certificate: all linking numbers that are not 0, and the pairs that touch. Open curves have
        none, which is an :class:`UnverifiedWarning`; ``Certificate.open`` lists them.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: a coordinate is not finite, a curve has too few points, no curve is closed, or
            the cell is no lattice.
    """
    points, numbers = _frame(curves, counts, closed)
    vectors = None if cell is None else arguments.twelve(cell)
    by_default = counts is None and closed is None
    basis = arguments.word("basis", basis, BASES)
    certificate, notes = _certify(points, numbers, basis, by_default, vectors)
    _warn_of_closing(notes)
    _warn_of_open(certificate.open, certificate.curves)
    return certificate


def _step(
    x0: Frame,
    x1: Frame,
    counts: Counts | None,
    closed: Closed | None,
    basis: str,
    events: str,
    cell: Cell | None,
) -> list[Report]:
    """Returns the reports on two successive frames."""
    session = Session(
        counts, closed=closed, basis=basis, events=events, incremental=False, cell=cell
    )
    reports = []
    for name, x in (("x0", x0), ("x1", x1)):
        points, numbers = arguments.frame(x, session._counts, closed, name)
        reports.append(session._session.step(points, numbers, 0.0))
        if reports[-1].rejected is not None:
            raise ValueError(f"{name}: {reports[-1].rejected}")
    return reports


def pull_throughs(
    x0: Frame,
    x1: Frame,
    counts: Counts | None = None,
    *,
    closed: Closed | None = None,
    basis: str = "polyline",
    events: str = "all",
    cell: Cell | None = None,
) -> list[PullThrough]:
    """Finds every passage of a curve through another one, or through itself, between two frames.

    Points move on straight lines at constant speed. In a cell, a curve that moved by about a
    lattice vector is moved back first.

    >>> import linkwatch
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
    >>> far = [[4, 0, -1], [6, 0, -1], [6, 0, 1], [4, 0, 1]]
    >>> linkwatch.pull_throughs([ring, other], [ring, far])[0].fraction
    0.25

    Returns:
        list[PullThrough]: in chronological order, with the time as a fraction of the step.

    Raises:
        UndecidedError: curves touch in a frame, or are too close to decide.
        ValueError: a coordinate is not finite, or a curve has too few points.
    """
    reports = _step(x0, x1, counts, closed, basis, events, cell)
    undecided = [d for r in reports for d in r.defects if d.kind != "no-baseline"]
    if undecided:
        raise UndecidedError("; ".join(str(d) for d in undecided))
    found = reports[1].pull_throughs + reports[1].unresolved
    return sorted(found, key=lambda p: p.fraction)


def safe_fraction(
    x0: Frame,
    x1: Frame,
    counts: Counts | None = None,
    *,
    closed: Closed | None = None,
    basis: str = "polyline",
    events: str = "all",
    cell: Cell | None = None,
) -> float:
    """Returns the largest proven fraction of the step from ``x0`` to ``x1`` without a pull-through.

    The fraction ``f`` is 1 if the step to ``x1`` is safe, and 0 if nothing is proven. Otherwise the
    step from ``x0`` to ``x0 + f * (x1 - x0)`` is proven, with every operation rounded to the
    precision of the points, and usually ends within a millionth of the step of the first
    pull-through. Two curves almost touch there.

    >>> import linkwatch
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
    >>> far = [[4, 0, -1], [6, 0, -1], [6, 0, 1], [4, 0, 1]]
    >>> linkwatch.safe_fraction([ring, other], [ring, far])
    0.249999998

    Raises:
        ValueError: a coordinate is not finite, or a curve has too few points.
    """
    fraction = _step(x0, x1, counts, closed, basis, events, cell)[1].safe_fraction
    return 0.0 if fraction is None else fraction


def _frame(
    curves: Frame, counts: Counts | None, closed: Closed | None
) -> tuple[npt.NDArray[Any], list[int]]:
    """Returns the points of all curves as one array, and the counts."""
    given = None if counts is None else arguments.integers(counts)
    return arguments.frame(curves, given, closed)


def _measured(
    curves: Frame, counts: Counts | None, closed: Closed | None, basis: str, cell: Cell | None
) -> tuple[npt.NDArray[Any], list[int], str, list[float] | None]:
    """Returns points, counts, basis and cell of a frame."""
    points, sizes = _frame(curves, counts, closed)
    vectors = None if cell is None else arguments.twelve(cell)
    basis = arguments.word("basis", basis, BASES)
    by_default = counts is None and closed is None
    if by_default or vectors is not None:
        decided = _decided(points, sizes, basis, vectors, by_default, 4)
        sizes = decided if by_default else sizes
    return points, sizes, basis, vectors


def _decided(
    points: npt.NDArray[Any],
    counts: list[int],
    basis: str,
    cell: list[float] | None,
    by_default: bool,
    level: int,
) -> list[int]:
    """Returns the counts of the curves of a frame in memory, below 0 if they are closed. Warns of
    decisions about curves that are closed ``by_default``, and of curves that may be torn.
    """
    decided, notes, torn = _decided_counts(points, counts, basis, cell, by_default)
    _warn_of_closing(notes if by_default else [], level + 1)
    if torn is not None:
        warnings.warn(torn, UnverifiedWarning, stacklevel=level)
    return decided


@overload
def thickness(  # type: ignore[overload-overlap]  # a text is a sequence
    curves: str | os.PathLike[str] | io.Frames | Iterator[Any],
    counts: Counts | None = None,
    *,
    closed: Closed | None = None,
    basis: str = "polyline",
    cell: Cell | None = None,
) -> npt.NDArray[np.float64]: ...
@overload
def thickness(
    curves: Frame,
    counts: Counts | None = None,
    *,
    closed: Closed | None = None,
    basis: str = "polyline",
    cell: Cell | None = None,
) -> Thickness: ...
def thickness(
    curves: Any,
    counts: Counts | None = None,
    *,
    closed: Closed | None = None,
    basis: str = "polyline",
    cell: Cell | None = None,
) -> Any:
    """Measures how sharply curves bend and how close they come (Ashton and Cantarella 2005).

    With a ``cell``, the curves are measured with all their images. Of a run, that is a path, frames
    of :func:`linkwatch.read`, a universe of MDAnalysis, or an iterator of frames, it returns the
    diameter ``Thickness.thickness()`` of each frame as an array; NaN if the frame is invalid.

    >>> import linkwatch
    >>> square = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]
    >>> found = linkwatch.thickness([square])
    >>> round(found.thickness(), 12), round(found.ropelength(), 12)
    (2.0, 4.0)

    Raises:
        ValueError: a coordinate is not finite, a curve has too few points, or the cell is no
            lattice.
    """
    if arguments.is_run(curves):
        from . import _series

        given = {"counts": counts, "closed": closed, "cell": cell}
        given["basis"] = None if basis == "polyline" else basis
        return _series.thickness(curves, given)
    return _thickness(_measured(curves, counts, closed, basis, cell))


def struts(
    curves: Frame,
    longest: float,
    counts: Counts | None = None,
    *,
    closed: Closed | None = None,
    basis: str = "polyline",
    cell: Cell | None = None,
) -> list[Strut]:
    """Finds all pairs of points whose distance is a local minimum of at most ``longest``.

    With a ``cell``, those between images are found, too, each once.

    >>> import linkwatch
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
    >>> linkwatch.struts([ring, other], longest=1.5)[0].length
    1.0

    Returns:
        list[Strut]: the shortest first, those of polylines with the gradient of their length.

    Raises:
        ValueError: a coordinate is not finite, a curve has too few points, or the cell is no
            lattice, or much smaller than ``longest``.
    """
    longest = arguments.number("longest", longest, "a length")
    return _struts(_measured(curves, counts, closed, basis, cell), longest)


def ribbon(
    curves: Frame,
    counts: Counts | None = None,
    *,
    strands: tuple[int, int] = (0, 1),
    pairing: str = "auto",
    axis: str = "centre",
    tolerance: float = 1e-4,
) -> Ribbon:
    """Computes linking number, twist and writhe of the ribbon between two closed polylines.

    The strands of DNA, for example. Both have the same number ``n`` of vertices.

    >>> import linkwatch
    >>> import numpy as np
    >>> a = 2 * np.pi * np.arange(48) / 48
    >>> axis = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    >>> turns = np.cos(3 * a)[:, None] * axis + np.sin(3 * a)[:, None] * [0, 0, 1]  # three
    >>> linkwatch.ribbon([axis, axis + 0.1 * turns], pairing="parallel", axis="first").linking
    -3

    Args:
        curves, counts: a frame.
        strands: the two curves, counted from 0.
        pairing: vertices that belong together: ``"parallel"`` (``k`` with ``k``),
            ``"antiparallel"`` (``k`` with ``n - 1 - k``, as in files of DNA), or one of these with
            a shift (``"antiparallel:1"``). ``"auto"`` takes the order of the vertices if paired
            vertices are close, else the pairing whose distances vary least;
            ``Ribbon.pairing`` says which, and ``Ribbon.rivals`` which others fit nearly as well.
        axis: ``"centre"``, the centre line of both, or ``"first"``, the first curve.
        tolerance: error of the writhe to reach, if possible.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: the curves cannot be the strands of a ribbon, or an argument is invalid.
    """
    frame = _measured(curves, counts, None, "polyline", None)
    if arguments.word("axis", axis, "'centre' or 'first'") not in ("centre", "first"):
        raise ValueError(f"axis is {axis!r}, expected 'centre' or 'first'")
    both = arguments.indices("strands", strands, len(frame[1]))
    pairing = arguments.word("pairing", pairing, "'auto', 'parallel' or 'antiparallel'")
    return _ribbon(frame, both, pairing, axis == "first", arguments.tolerance(tolerance))


def diagram(
    curves: Frame,
    counts: Counts | None = None,
    *,
    closed: Closed | None = None,
    basis: str = "polyline",
    groups: bool = True,
) -> list[Diagram]:
    """Computes the exact planar diagrams of closed curves, reduced by Reidemeister moves I and II.

    >>> import linkwatch
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
    >>> for found in linkwatch.diagram([ring, other]):
    ...     print(found)
    curve 0: 0 crossings; v2 0, v3 0, determinant 1: unknot
    curve 1: 0 crossings; v2 0, v3 0, determinant 1: unknot
    curves 0, 1: 2 crossings; determinant 2, 1 linking number

    Args:
        curves, counts, closed, basis: a frame. Open curves are skipped.
        groups: diagrams of connected groups of several curves, too. Curves that are in no group
            can be pulled away from all others.

    Returns:
        list[Diagram]: those of all closed curves, each by itself, then those of groups.

    Raises:
        UndecidedError: a curve touches itself or another one.
        ValueError: a coordinate is not finite, or a curve has too few points.
    """
    if type(groups) is not bool:
        raise TypeError(f"groups is {groups!r}, expected True or False")
    found, undecided = _diagram(_measured(curves, counts, closed, basis, None), groups)
    if undecided:
        raise UndecidedError("; ".join(undecided))
    return found


def identify(diagram: Diagram) -> list[str]:
    """Returns the names of a knot or link in the tables of Rolfsen and of Hoste and Thistlethwaite,
    found by SnapPy (``pip install "linkwatch[knots]"``).

    The complement must be hyperbolic and in SnapPy's census. Torus knots and composite knots are
    not: of these, only ``3_1`` and ``5_1`` are found. Mirror images have the same name.

    >>> import linkwatch
    >>> import numpy as np
    >>> t = 2 * np.pi * np.arange(60) / 60
    >>> r = 2 + np.cos(3 * t)
    >>> trefoil = np.stack([r * np.cos(2 * t), r * np.sin(2 * t), np.sin(3 * t)], axis=1)
    >>> linkwatch.identify(linkwatch.diagram([trefoil])[0])  # doctest: +SKIP
    ['3_1']
    >>> linkwatch.identify(linkwatch.diagram([trefoil[:8]], closed=True)[0])
    ['unknot']

    Args:
        diagram: the diagram of a curve or of a group.

    Raises:
        ImportError: SnapPy is not installed.
    """
    from .io._frames import library

    if not isinstance(diagram, Diagram):
        raise TypeError(f"diagram is {type(diagram).__name__}, expected a Diagram")
    if not diagram.pd and diagram.name:
        return [diagram.name]
    snappy = library("snappy", "knots", "the name of a knot")
    link = snappy.Link([list(crossing) for crossing in diagram.pd])
    link.simplify("global")
    if diagram.name and len(link.crossings) <= 5:
        return [diagram.name]  # its invariants tell it from all others with so few
    if link.unlinked_unknot_components:
        return []  # splittable
    exterior = link.exterior()
    return [
        found.name()
        for found in exterior.identify()
        if re.fullmatch(r"\d+(\^\d+)?_\d+|[KL]\d+[an]\d+", found.name())
        # The complement determines a knot, but not a link.
        and any(
            isometry.extends_to_link()
            for isometry in exterior.is_isometric_to(found, return_isometries=True)
        )
    ]


def assert_intact(
    frames: Iterable[Frame],
    counts: Counts | None = None,
    *,
    baseline: Certificate | None = None,
    **options: Any,
) -> None:
    """Fails unless every frame is intact; for tests of simulations.

    >>> import linkwatch
    >>> ring = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    >>> other = [[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]]
    >>> frames = [[ring, [[x + move, y, z] for x, y, z in other]] for move in (0, 0.4, 4)]
    >>> linkwatch.assert_intact(frames[:2])
    >>> linkwatch.assert_intact(frames)
    Traceback (most recent call last):
    AssertionError: frame 2: changed (1 link lost, 1 pull-through)
      curves 0 and 1 came apart: ...

    Args:
        frames: frames of one simulation, in order.
        counts, baseline, options: those of :class:`Session`.

    Raises:
        AssertionError: names the first frame that is not intact, its curves and the place; or says
            what was not verified, as :func:`check` does.
    """
    from ._run import Run

    session = Session(counts, baseline=baseline, **options)
    run = Run(None, {**options, "baseline": baseline})
    for frame in frames:
        if hasattr(frame, "positions"):
            raise TypeError(
                "the frames are those of a file, or linkwatch.io.Frame objects: "
                "`assert linkwatch.check(frames)` verifies them"
            )
        frame = frame if hasattr(frame, "__len__") else list(frame)
        report = session.step(frame)
        if not report.intact:
            raise AssertionError(str(report))
        run._curves = len(frame if counts is None else counts)
        run._has_pairs |= run._curves > 1 or options.get("cell") is not None
        run._followed += bool(run.frames)
        run._add(report)
    run._end(session)
    if gaps := run._gaps():
        raise AssertionError("; ".join(gaps))


# Modules that are imported when they are needed, so that importing the package takes no time.
_LATER = {
    "io": "io",
    "distributed": "distributed",
    "mdanalysis": "mdanalysis",
    "read": "io",
    "write": "io",
    "Run": "_run",
    "check": "_run",
    "writhe": "_series",
    "linking": "_series",
    "twist": "_series",
    "gauss_integrals": "_series",
}

if not TYPE_CHECKING:

    def __dir__():
        return sorted({*globals(), *_LATER})

    def __getattr__(name):
        if name in _LATER:
            import importlib

            module = importlib.import_module(f".{_LATER[name]}", __name__)
            return module if name == _LATER[name] else getattr(module, name)
        instead = " (it is Session now)" if name == "Verifier" else ""
        raise AttributeError(f"module 'linkwatch' has no attribute {name!r}{instead}")
