"""Verification of all frames of a run, and its result as text, tables, plots and pages."""

from __future__ import annotations

import base64
import dataclasses
import functools
import inspect
import itertools
import os
import subprocess
import sys
import tempfile
import warnings
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from . import Certificate, Session, UnverifiedWarning, _linkwatch, _view, certify, io
from . import _arguments as arguments
from .io._curves import plural
from .io._frames import Frame, Frames, Summary, library

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from typing import Any

    from ._results import Change, Defect, Report, Result

#: Columns of the tables of a run.
COLUMNS = {
    "frames": "frame time verdict changes invariants pull_throughs unresolved defects clearance "
    "rejected",
    "changes": "i j names image expected found frame time last frames point segments distance",
    "invariants": "curves expected found frame time last frames",
    "defects": "i j names image kind frame time last frames point segments distance",
    "pull_throughs": "frame time i j names image segments fraction sign point lengths unresolved",
}
#: Row of a frame that is intact, without its number and its time.
PLAIN = {
    **dict.fromkeys(COLUMNS["frames"].split(), 0),
    **{"verdict": "intact", "clearance": None, "rejected": None},
}
#: Number of frames that are read ahead, so that the thread that reads them need not wait for each.
AHEAD = 3
#: Number of findings that a summary prints of each kind.
PRINTED = 5


def frames_of(
    given: Any, *, keep_open: bool = False, wrapped: bool | None = None, **options: Any
) -> Frames:
    """Returns what :func:`check` takes as frames of files."""
    if isinstance(given, (str, os.PathLike)):
        given = [given]
    read: Callable[..., Frames] = frames_in_memory
    args = [given]
    if isinstance(given, Frames):
        read = lambda frames: frames  # noqa: E731
    elif isinstance(given, (list, tuple)) and given and isinstance(given[0], (str, os.PathLike)):
        read, args = functools.partial(io.read, keep_open=keep_open), list(given)
        format = io.format_of(Path(given[0]))
        # The command refuses curves that are torn, unless it unwraps them.
        is_told = wrapped is False or wrapped and format.name == "linkwatch"
        if is_told and "unwrap" in format.options.split():
            options.setdefault("unwrap", wrapped)
    elif hasattr(given, "universe") and hasattr(given, "atoms"):
        read = io.from_mdanalysis
        if wrapped is False:
            options.setdefault("unwrap", False)
    options = {name: value for name, value in options.items() if value is not None}
    for name in options:
        if name not in inspect.signature(read).parameters:
            kind = type(given).__name__
            raise TypeError(f"there is no option {name!r} for frames of this kind ({kind})")
    try:
        return read(*args, **options)
    except ValueError as why:
        if "`unwrap" not in str(why):
            raise
        # Here the option has the name that it has for a session.
        raise ValueError(str(why).replace("`unwrap", "`wrapped")) from None


def frames_in_memory(
    given: Any,
    *,
    counts: Any = None,
    closed: Any = None,
    names: Any = (),
    basis: str = "polyline",
    cell: Any = None,
) -> Frames:
    """Returns an iterable of frames of all forms as frames of files."""
    if not hasattr(given, "__iter__"):
        raise TypeError(f"frames is {given!r}, expected a path, frames, or an iterable of frames")
    numbers = None if counts is None else arguments.integers(counts)
    labels = arguments.words("names", names)
    vectors = None if cell is None else np.reshape(arguments.twelve(cell), (4, 3))
    by_default = counts is None and closed is None
    options = {"counts": counts, "closed": closed, "names": labels or None, "cell": cell}
    given_options = [name for name, value in options.items() if value is not None]
    given_options += ["basis"] if basis != "polyline" else []

    def load() -> Iterator[Frame]:
        for seq, one in enumerate(given):
            if not isinstance(one, Frame):
                points, sizes = arguments.frame(one, numbers, closed, f"frame {seq}")
                at = float(seq)
                one = Frame(points, sizes, basis, labels, [], vectors, seq, at, None, by_default)
            else:
                if given_options:
                    raise TypeError(
                        f"frame {seq} is a `Frame`, with counts, names, basis and cell of its own: "
                        f"there is no option {given_options[0]!r} for it"
                    )
                left_out = found.summary.left_out
                left_out += [what for what in one.left_out if what not in left_out]
                if one.seq == 0:
                    # The default of all.
                    one = dataclasses.replace(one, seq=seq)
            yield one

    found = Frames(Path("frames"), load, Summary(), getattr(given, "__len__", lambda: None)())
    found.kind = "once" if iter(given) is given else "memory"
    return found


class Run:
    """Result of :func:`linkwatch.check`. It is true if all frames were verified and are intact.

    >>> import linkwatch
    >>> ring = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    >>> other = np.array([[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1.0]])
    >>> run = linkwatch.check([[ring, other + [0.4 * k, 0, 0]] for k in range(4)])
    >>> run.frames[3]["verdict"], run.pull_throughs[0]["frame"], run.pull_throughs[0]["point"]
    ('changed', 3, [1.0, 0.0, 0.0])

    ``print(run)`` says what happened. All tables are lists of dicts:

    Attributes:
        frames: number (``frame``), time and verdict of each frame, the numbers of its findings, its
            clearance if it is measured, and why it was rejected if it was.
        changes: each linking number that differs from the baseline, once: the first frame that has
            it (``frame``, ``time``), the last one, their number (``frames``), and the place in the
            first one.
        invariants: knots and triple linking numbers that differ from the baseline, likewise.
        defects: pairs and curves without a linking number, or with an undecided step, likewise.
        pull_throughs: each one, with the frame at the end of the step; ``unresolved`` if it may not
            be real, because the frames are too far apart.
        notes: decisions about closed and open curves, and others.
        left_out: elements that may be curves and were not read.
    """

    def __init__(self, source: Frames | None, options: dict[str, Any]) -> None:
        self.source = source
        self.options = options
        self.frames: list[dict[str, Any]] = []
        self.pull_throughs: list[dict[str, Any]] = []
        self.notes: list[str] = []
        tables = ("changes", "invariants", "defects")
        self._lasting: dict[str, dict[Any, dict[str, Any]]] = {table: {} for table in tables}
        self._left_out: dict[str, str] = {}
        self._first: str | None = None
        self._open = self._jumps = 0
        #: Largest number of curves of a frame.
        self._curves = 0
        self._has_pairs = False
        #: Number of steps between frames that were searched, if any are.
        self._followed = 0
        self._unmeasured: str | None = None

    @property
    def changes(self) -> list[dict[str, Any]]:
        """Linking numbers that differ from the baseline, each once."""
        return list(self._lasting["changes"].values())

    @property
    def invariants(self) -> list[dict[str, Any]]:
        """Knots and triple linking numbers that differ from the baseline, each once."""
        return list(self._lasting["invariants"].values())

    @property
    def defects(self) -> list[dict[str, Any]]:
        """Pairs and curves without a linking number, and undecided steps, each once."""
        return list(self._lasting["defects"].values())

    @property
    def left_out(self) -> list[str]:
        """Elements that may be curves and were not read, by kind, with the first one."""
        of_files = [] if self.source is None else self.source.summary.left_out
        return [*of_files, *self._left_out.values()]

    def _add(self, report: Report) -> None:
        """Adds the report on the next frame."""
        of_frame = {"frame": report.seq, "time": report.time}
        if report._plain:
            self.frames.append({**PLAIN, **of_frame})
            return
        row: dict[str, Any] = {**of_frame, "verdict": report.verdict, "rejected": report.rejected}
        for name in ("changes", "invariants", "pull_throughs", "unresolved", "defects"):
            row[name] = len(getattr(report, name))
        row["clearance"] = report.clearance and report.clearance.ratio
        self.frames.append(_in_order("frames", row))
        for change in report.changes:
            key = (*_curves(change), change.expected, change.found)
            self._add_lasting("changes", key, change, of_frame)
        for invariant in report.invariants:
            key = (invariant.curves, invariant.expected, invariant.found)
            self._add_lasting("invariants", key, invariant, of_frame)
        for defect in report.defects:
            self._add_lasting("defects", (*_curves(defect), defect.kind), defect, of_frame)
        for passage in report.pull_throughs + report.unresolved:
            row = {**of_frame, **passage.to_dict(), "unresolved": passage in report.unresolved}
            self.pull_throughs.append(_in_order("pull_throughs", row))
        for found in report._json["left_out"]:
            words = f"{found['count']} {found['kind']} (the first one: {found['first']})"
            self._left_out.setdefault(found["kind"], words)
        if self._first is None and report.verdict not in ("intact", "rejected"):
            self._first = "\n    ".join([report._words, *report.findings[:1]])

    def _add_lasting(
        self, table: str, key: tuple[Any, ...], found: Result, of_frame: dict[str, Any]
    ) -> None:
        """Adds a finding that may last over several frames."""
        row = self._lasting[table].get(key)
        if row is None:
            row = {**of_frame, **found.to_dict(), "frames": 0}
            row = self._lasting[table][key] = _in_order(table, {**row, **(row.get("place") or {})})
        row["last"] = of_frame["frame"]
        row["frames"] += 1

    def _note(self, notes: list[str]) -> None:
        self.notes += [note for note in notes if note not in self.notes]

    def _end(self, session: Session) -> None:
        """Adds what the session knows after the last frame."""
        raw = session._session
        self._open, self._jumps = raw.most_open(), raw.jumps()
        self._unmeasured = raw.unmeasured_clearance()

    def _merge(self, later: Run) -> None:
        """Adds the frames of a run that continues this one."""
        self.frames += later.frames
        self.pull_throughs += later.pull_throughs
        self._note(later.notes)
        for table, rows in later._lasting.items():
            for key, row in rows.items():
                own = self._lasting[table].setdefault(key, {**row, "frames": 0})
                own["last"], own["frames"] = row["last"], own["frames"] + row["frames"]
        self._left_out = {**later._left_out, **self._left_out}
        self._first = self._first or later._first
        self._open, self._jumps = max(self._open, later._open), later._jumps
        self._curves = max(self._curves, later._curves)
        self._has_pairs |= later._has_pairs
        self._followed += later._followed
        self._unmeasured = self._unmeasured or later._unmeasured

    def _gaps(self) -> list[str]:
        """Returns what was not verified, or not decided."""
        verdicts = [row["verdict"] for row in self.frames]
        rejected, verified = verdicts.count("rejected"), len(verdicts) - verdicts.count("rejected")
        gaps = []
        for verdict in ("contact", "undecided"):
            if number := verdicts.count(verdict):
                gaps.append(f"{_frames(number)} with the verdict {verdict}")
        if rejected:
            first = next(row for row in self.frames if row["rejected"] is not None)
            why = f"the first one is frame {first['frame']}: {first['rejected']}"
            gaps.append(f"{_frames(rejected)} rejected; {why}")
        if not verified:
            gaps.append("no frame was verified")
        baseline = self.options.get("baseline")
        if verified == 1 and baseline is None:
            gaps.append("one frame, and nothing to compare it with")
        kinds: Any = self.options.get("invariants") or getattr(baseline, "invariants", "")
        compared = verified > 1 or verified == 1 and baseline is not None
        only_open = self._open == self._curves
        # An open curve is no knot.
        has_knots = "self" in kinds and not only_open
        sees_itself = verified > 1 and self.options.get("events") == "all" or has_knots
        if compared and not self._has_pairs and not sees_itself:
            gaps.append(
                "nothing was verified: one curve alone has no linking number; events='all' "
                "searches for pull-throughs of a curve with itself, invariants='self' compares its "
                "knot"
            )
        if verified == 1 and baseline is not None and only_open:
            gaps.append("nothing was verified: open curves are searched from frame to frame")
        is_off = self.options.get("events") == "off"
        if self._open and verified > 1 and (is_off or not self._followed):
            curves = plural(self._open, "open curve", "open curves")
            why = "events='between' searches for pull-throughs"
            gaps.append(f"not verified: {curves} ({why if is_off else 'no step was searched'})")
        if self._unmeasured:
            gaps.append(f"clearance was not measured in all frames: {self._unmeasured}")
        if self.left_out:
            gaps.append(f"not read, so not verified: {', '.join(self.left_out)}")
        return gaps

    @property
    def verdict(self) -> str:
        """``"intact"``, ``"changed"``, or ``"incomplete"``: something is undecided, was rejected or
        not read. The exit codes 0, 1 and 3 of ``linkwatch check`` have the same meaning, except
        that the command returns 0 if all violations were rolled back later.
        """
        if any(row["verdict"] == "changed" for row in self.frames):
            return "changed"
        return "incomplete" if self._gaps() else "intact"

    def __bool__(self) -> bool:
        return self.verdict == "intact"

    @property
    def summary(self) -> str:
        """Summary of the run, in some lines."""
        lines = [f"{self.verdict}: {_frames(len(self.frames))}"]
        if self._first is not None:
            lines.append(f"first frame that is not intact: {self._first}")
        resolved = sum(not row["unresolved"] for row in self.pull_throughs)
        unresolved, changes = len(self.pull_throughs) - resolved, len(self.changes)
        if changes:
            numbers = plural(changes, "linking number differs", "linking numbers differ")
            lines.append(f"{numbers} from the baseline")
        if self.invariants:
            differ = plural(len(self.invariants), "invariant differs", "invariants differ")
            lines.append(f"{differ} from the baseline")
        if resolved:
            lines.append(plural(resolved, "pull-through", "pull-throughs"))
        if unresolved:
            passages = plural(unresolved, "unresolved pull-through", "unresolved pull-throughs")
            why = "because the frames are too far apart"
            lines.append(f"{passages}, {why} (events='off' compares linking numbers alone)")
        measured = [row for row in self.frames if row["clearance"] is not None]
        if measured:
            low = min(measured, key=lambda row: row["clearance"])
            share = f"{100 * low['clearance']:.1f} % of the diameter"
            lines.append(f"lowest clearance: {share}, in frame {low['frame']}")
        rejected = sum(row["rejected"] is not None for row in self.frames)
        curves = plural(self._open, "open curve", "open curves")
        if self._open and len(self.frames) - rejected == 1:
            lines.append(f"not verified: {curves} (searched from one frame to the next)")
        elif self._open and self._followed and self.options.get("events") != "off":
            lines.append(f"{curves} verified for pull-throughs, without linking numbers")
        if self._jumps:
            times = plural(self._jumps, "time", "times")
            what = f"curves jumped by a lattice vector {times}"
            lines.append(f"{what}, and were followed")
        of_files = [] if self.source is None else self.source.summary.notes
        return "\n  ".join([*lines, *self._gaps(), *of_files, *self.notes])

    def __str__(self) -> str:
        return self.summary

    def __repr__(self) -> str:
        return f"<Run: {self.summary.splitlines()[0]}>"

    def __getstate__(self) -> dict[str, Any]:
        source = self.source if self.source is not None and self.source.recipe else None
        return {**self.__dict__, "source": source}

    def to_dict(self) -> dict[str, Any]:
        """Returns verdict, summary, tables and notes as plain data."""
        tables = {table: getattr(self, table) for table in COLUMNS}
        said = {"verdict": self.verdict, "summary": self.summary, "left_out": self.left_out}
        return {**said, **tables, "notes": self.notes}

    def to_pandas(self, table: str = "frames") -> Any:
        """Returns a table as a ``pandas.DataFrame``: ``"frames"``, ``"changes"``, ``"invariants"``,
        ``"defects"`` or ``"pull_throughs"``.

        Raises:
            ImportError: pandas is not installed.
            ValueError: there is no such table.
        """
        if table not in COLUMNS:
            raise ValueError(f"table is {table!r}, expected one of {', '.join(COLUMNS)}")
        pandas = library("pandas", "analysis", "a table")
        return pandas.DataFrame(getattr(self, table), columns=COLUMNS[table].split())

    def plot(self) -> Any:
        """Returns a figure of ``matplotlib``: findings, and clearance if it is measured, over time,
        or over the number of the frame if all times are equal.

        Raises:
            ImportError: matplotlib is not installed.
        """
        figure = library("matplotlib.figure", "analysis", "a plot")
        rows = self.frames
        timed = len({row["time"] for row in rows}) > 1
        x = [row["time" if timed else "frame"] for row in rows]
        clear = any(row["clearance"] is not None for row in rows)
        drawn = figure.Figure(figsize=(8, 6 if clear else 4.5), layout="constrained")
        axes = drawn.subplots(3 if clear else 2, 1, sharex=True)
        links, passages = axes[:2]
        links.step(x, [row["changes"] for row in rows], where="post", color="C3")
        links.set_ylabel("changed links")
        width = 0.8 * min(np.diff(np.unique(x)), default=1.0)
        names = ("pull_throughs", "unresolved")
        found, unresolved = ([row[name] for row in rows] for name in names)
        passages.bar(x, found, width, color="C0", label="pull-throughs")
        if any(unresolved):
            passages.bar(x, unresolved, width, bottom=found, color="0.7", label="unresolved")
            passages.legend()
        passages.set_ylabel("pull-throughs")
        if clear:
            share = [np.nan if row["clearance"] is None else row["clearance"] for row in rows]
            axes[2].plot(x, share, color="C2")
            axes[2].set_ylabel("clearance / diameter")
        for axis in axes[:2]:
            axis.yaxis.get_major_locator().set_params(integer=True)
            axis.set_ylim(0, max(1.0, 1.05 * axis.get_ylim()[1]))
        for row, at in zip(rows, x):
            if row["verdict"] not in ("intact", "changed"):
                for axis in axes:
                    axis.axvspan(at - width / 2, at + width / 2, color="C1", alpha=0.2, lw=0)
        axes[-1].set_xlabel("time" if timed else "frame")
        links.set_title(repr(self)[6:-1])
        return drawn

    def _repr_html_(self) -> str:
        """Returns the summary, the pictures of the first violation, and the plot."""
        import html
        from io import BytesIO

        shown = [f"<pre style='white-space: pre-wrap'>{html.escape(self.summary)}</pre>"]
        if (picture := self._picture()) is not None:
            shown.append(_image("svg+xml", picture, "before, at and after the first violation"))
        try:
            plot = BytesIO()
            self.plot().savefig(plot, format="png", dpi=80)
            shown.append(_image("png", plot.getvalue(), "findings over time"))
        except ImportError:
            pass
        return "".join(shown)

    def _picture(self) -> bytes | None:
        """Returns the picture that the report has of the first violation, as SVG: the curves before
        it, in its frame, and after it. None if the frames cannot be read again.
        """
        verdicts = [row["verdict"] for row in self.frames]
        at = next((k for k, v in enumerate(verdicts) if v not in ("intact", "rejected")), None)
        if at is None or self.source is None or self.source.kind == "once":
            return None
        try:
            # A second source: reading a part of the first one would change its summary.
            source, recipe = self.source, self.source.recipe
            source = recipe[0](*recipe[1], **recipe[2]) if recipe else source
            part = source.part or (lambda start, stop: itertools.islice(source, start, stop))
            options = dict(self.options)
            if options["baseline"] is None and at > 1:
                (first,) = part(0, 1)
                given = first.positions, first.counts
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # about open curves
                    if any(first.closed):
                        baseline = certify(*given, basis=first.basis, cell=first.cell)
                        options["baseline"] = baseline
            near = frames_in_memory(list(part(max(at - 1, 0), min(at + 2, len(verdicts)))))
            with tempfile.TemporaryDirectory(prefix="linkwatch-") as folder:
                recording = Path(folder) / "run.mcap"
                Run(near, options).record(recording)
                _command("report", recording, "--svg", folder)
                return (Path(folder) / "violation-1.svg").read_bytes()
        except (ImportError, OSError, ValueError):
            return None  # the report says why

    def record(
        self, path: str | os.PathLike[str], *, force: bool = False, settings: str = ""
    ) -> None:
        """Verifies the frames again by the command ``linkwatch check --record``.

        The recording is for ``linkwatch replay``, ``report``, and other tools: ``settings`` are
        those of ``--record``; such as ``"every=10"``. The frames are read again,
        so those of a generator have no recording.

        Raises:
            FileExistsError: there is such a file, and ``force`` is false.
            ValueError: the frames cannot be read again, or not be recorded.
        """
        if self.source is None or self.source.kind == "once":
            raise ValueError("the frames cannot be read again: check a file, or a list of frames")
        if Path(path).exists() and not force:
            raise FileExistsError(f"{path} exists already: `force` overwrites it")
        options = self.options
        words = [f"--events={options['events']}"]
        if options["motion_limit"] is not None:
            words += ["--motion-limit", repr(options["motion_limit"])]
        if options["invariants"]:
            words.append(f"--invariants={options['invariants']}")
        if options["wrapped"] is not None:
            words.append(f"--wrapped={str(options['wrapped']).lower()}")
        if options["keep_open"]:
            words.append("--keep-open")
        with tempfile.TemporaryDirectory(prefix="linkwatch-") as folder:
            if options["baseline"] is not None:
                certificate = Path(folder) / "baseline.txt"
                options["baseline"].write(certificate)
                words += ["--baseline", str(certificate)]
            files = io.write(self.source, Path(folder) / f"{self.source.path.stem}.npz")
            if len(files) > 1:
                words.append("--one-motion")
            record = ",".join(filter(None, [str(path), settings]))
            _command("check", *files, *words, "--force", "--record", record)

    def view(self, path: str | os.PathLike[str] | None = None) -> None:
        """Shows the frames in the rerun viewer: in the notebook, or else in a window. ``path``
        writes a file for ``rerun FILE.rrd`` instead.

        Curves of a change or a pull-through of the frame are red, places of pull-throughs blue.
        The frames are read again, as for :meth:`record`. ``linkwatch replay --show`` of a
        recording shows more; that command is in the Rust build with its viewer.

        Raises:
            ImportError: rerun is not installed: ``pip install "linkwatch[viewer]"``.
            ValueError: the frames cannot be read again.
        """
        _view.view(self, path)

    def report(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Writes the page of ``linkwatch report``: what happened, with tables and pictures.

        The frames are verified again for it: see :meth:`record`, which raises the same errors.
        """
        if Path(path).exists() and not force:
            raise FileExistsError(f"{path} exists already: `force` overwrites it")
        with tempfile.TemporaryDirectory(prefix="linkwatch-") as folder:
            name = "run" if self.source is None else self.source.path.stem
            recording = Path(folder) / f"{name}.mcap"
            self.record(recording)
            _command("report", recording, "--force", "-o", path)


def _in_order(table: str, row: dict[str, Any]) -> dict[str, Any]:
    """Returns the columns of a table in a row."""
    return {column: row.get(column) for column in COLUMNS[table].split()}


def _curves(found: Change | Defect) -> tuple[Any, ...]:
    """Returns the curves of a finding."""
    return found.names or (found.i, found.j), found.image


def _image(kind: str, data: bytes, text: str) -> str:
    """Returns a picture as HTML."""
    source = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
    return f'<img src="{source}" alt="{text}"/>'


def _frames(number: int) -> str:
    return plural(number, "frame", "frames")


def _command(*words: Any) -> None:
    """Runs a command of linkwatch. The exit codes 0, 1 and 3 are verdicts."""
    words = (sys.executable, "-m", "linkwatch", *map(str, words))
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    if ended.returncode not in (0, 1, 3):
        raise ValueError(ended.stderr.strip().removeprefix("error: "))


class Checker:
    """Verifies frames by a session, and adds them to a run. Begins with a state of another one."""

    def __init__(self, run: Run, state: tuple[bytes, Any] | None = None) -> None:
        self.run = run
        self.session: Session | None = None
        self._state: bytes | None = None
        #: Description of the curves of the last frame, and of the last verified one.
        self._described: Any = None
        #: Cuts before the last verified frame.
        self._cuts: int | None = None
        if state is not None:
            self._state, (self._described, self._cuts) = state
        self._verified = self._described

    def step(self, frame: Frame, *, begins_part: bool = False) -> Report:
        """Verifies a frame."""
        options = dict(self.run.options)
        given = options["radius"]
        published = given == "published"
        radii = frame.radii if published else given if isinstance(given, list) else []
        if self.session is None:
            if published and not radii:
                raise ValueError(f"frame {frame.seq} has no radii: give a radius")
            if published:
                options["radius"] = radii
            self.session = Session(basis=frame.basis, _state=self._state, **options)
            self._basis = frame.basis
        if frame.basis != self._basis:
            raise ValueError(f"frame {frame.seq} has the basis {frame.basis}, not {self._basis}")
        raw = self.session._session
        if self._verified and not self._verified[1]:
            # Without names, the curves must keep the description of the last verified frame.
            _, _, of_curves, by_default = self._verified
            why = None
            if not frame.names and radii != of_curves:
                why = "other radii than before: give a fixed radius, or name the curves"
            elif frame.names or frame.closed_by_default != by_default:
                why = (
                    "the curves were described again, but have no names to compare them by: give "
                    "each curve a name from the first frame on"
                )
            if why is not None:
                radii, why = of_curves, frame.rejected or why
                frame = frame.invalid(why, names=[], closed_by_default=by_default)
        described_counts = frame.counts if frame.names else None
        described = described_counts, frame.names, radii, frame.closed_by_default
        if described != self._described:
            raw.describe(*described[1:])
            self._described = described
        if begins_part:
            raw.begin_part()
        elif self._cuts not in (None, frame.cuts):
            raw.cut()
        cell = None if frame.cell is None else arguments.twelve(frame.cell)
        points, counts = arguments.frame(frame.positions, frame.counts, None)
        report = raw.step(points, counts, frame.time, (frame.seq, cell, frame.rejected))
        if report.rejected is None:
            self.run._followed += self._cuts == frame.cuts and not begins_part
            self._verified, self._cuts = described, frame.cuts
        return report

    def verify(self, frames: Iterable[Frame]) -> None:
        """Verifies frames, and adds them to the run."""
        begins = self._state is None
        for frame in frames:
            self.run._curves = max(self.run._curves, len(frame.counts))
            self.run._has_pairs |= len(frame.counts) > 1 or frame.cell is not None
            report = self.step(frame)
            self.run._add(report)
            if begins and frame.cell is None and report.rejected is None:
                points, counts = arguments.frame(frame.positions, frame.counts, None)
                long = _linkwatch.long_segment(points, counts, frame.basis)
                if long is not None:
                    self.run._note([long])
                    warnings.warn(long, UnverifiedWarning, stacklevel=3)
            begins = begins and report.rejected is not None
            assert self.session is not None
            self.run._note(self.session._session.notes())
        if self.session is not None:
            self.run._end(self.session)

    def state(self) -> tuple[tuple[bytes, Any], int]:
        """Returns the state after the last frame, and a hash of what findings depend on."""
        assert self.session is not None
        state, number = self.session._session.state()
        return (state, (self._verified, self._cuts)), number


def ahead(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Yields frames. Another thread reads the next ones meanwhile."""
    with ThreadPoolExecutor(1) as pool:
        left = iter(frames)
        coming = deque(pool.submit(next, left, None) for _ in range(AHEAD))
        while (frame := coming.popleft().result()) is not None:
            coming.append(pool.submit(next, left, None))
            yield frame


def bar(steps: Iterable[Any], total: int | None, wanted: bool | None, unit: str) -> Any:
    """Shows the progress of steps by ``tqdm``: on a terminal if it is installed, or as wanted."""
    if wanted is False:
        return steps
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a notebook without ipywidgets has a bar of text
            tqdm = library("tqdm.auto", "analysis", "a progress bar")
    except ImportError:
        if wanted:
            raise
        return steps
    return tqdm.tqdm(steps, total=total, unit=unit, disable=None if wanted is None else False)


def options_of(
    baseline: Certificate | str | os.PathLike[str] | None = None,
    events: str = "between",
    radius: Any = None,
    motion_limit: float | None = None,
    invariants: str = "",
    wrapped: bool | None = None,
    keep_open: bool = False,
) -> dict[str, Any]:
    """Returns the options of a session that verifies a run."""
    if isinstance(baseline, (str, os.PathLike)):
        baseline = Certificate.read(baseline)
    if radius is not None and np.ndim(radius) == 1:
        radius = np.asarray(radius, float).tolist()
    return dict(
        baseline=baseline,
        events=events,
        radius=radius,
        motion_limit=motion_limit,
        invariants=invariants,
        wrapped=wrapped,
        keep_open=keep_open,
    )


def check(
    frames: Any,
    baseline: Certificate | str | os.PathLike[str] | None = None,
    events: str = "between",
    *,
    radius: Any = None,
    motion_limit: float | None = None,
    invariants: str = "",
    wrapped: bool | None = None,
    keep_open: bool = False,
    progress: bool | None = None,
    client: Any = None,
    chunk: int | None = None,
    **described: Any,
) -> Run:
    """Verifies the frames of one run.

    >>> import linkwatch
    >>> ring = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    >>> other = np.array([[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1.0]])
    >>> run = linkwatch.check([[ring, other + [0.4 * k, 0, 0]] for k in range(6)])
    >>> run.verdict, bool(run)
    ('changed', False)
    >>> [(row["frame"], row["i"], row["j"], row["found"]) for row in run.changes]
    [(3, 0, 1, 0)]

    Args:
        frames: a path, or several ones that :func:`linkwatch.read` takes together; what it returns;
            a ``Universe`` or ``AtomGroup`` of MDAnalysis; or an iterable of frames, each one a
            :class:`linkwatch.io.Frame` or in one of the two forms of ``help(linkwatch)``, at the
            times 0, 1, 2, ..
        baseline: expected linking numbers, or their file; by default those of the first frame.
        events: pull-throughs to search for from frame to frame: ``"between"`` different curves,
            ``"all"`` (also of a curve through itself), or ``"off"``, which compares linking numbers
            alone, for frames that are far apart.
        radius: radius of the strands, of each curve, or ``"published"``, those of the frames:
            ``run.frames`` has the clearance.
        motion_limit, invariants, wrapped, keep_open: those of :class:`linkwatch.Session`.
        progress: whether to show a progress bar; by default on a terminal, if ``tqdm`` is
            installed.
        client: ``dask.distributed.Client`` or ``concurrent.futures.Executor``: verifies chunks of
            frames at the same time. See :mod:`linkwatch.distributed`.
        chunk: number of frames of a chunk.
        described: ``counts``, ``closed``, ``names``, ``basis`` and ``cell`` of arrays; options of
            :func:`linkwatch.read` for files, and of :func:`linkwatch.io.from_mdanalysis`.

    Raises:
        ImportError: a library to read the frames is not installed. The message says how.
        TypeError, ValueError: an argument is invalid, a file is damaged, or no curve is closed and
            there are no ``events``.
    """
    options = options_of(
        baseline, events, radius, motion_limit, invariants, wrapped, keep_open
    )
    source = frames_of(frames, keep_open=keep_open, wrapped=wrapped, **described)
    given = source.recipe[2] if source.recipe else {}
    if given.get("closed") is False or given.get("keep_open"):
        # A session would close curves that a reader kept open.
        options["keep_open"] = True
    run = Run(source, options)
    if client is not None:
        from .distributed import verify

        verify(run, client, chunk, progress)
    else:
        read = ahead(source) if source.kind == "file" else source
        Checker(run).verify(bar(read, source.length, progress, " frames"))
    return run
