"""Verification as an analysis of MDAnalysis, with its frames, progress bar and backends."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from . import distributed
from ._run import Run, options_of
from .io import from_mdanalysis
from .io._frames import library

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import Any

_base = library("MDAnalysis.analysis.base", "mdanalysis", "an analysis of MDAnalysis")
_backends = library("MDAnalysis.analysis.backends", "mdanalysis", "an analysis of MDAnalysis")
_log = library("MDAnalysis.lib.log", "mdanalysis", "an analysis of MDAnalysis")


class _Spawned(_backends.BackendMultiprocessing):  # type: ignore[misc,name-defined]
    """Starts new processes without a fork: linkwatch fails in the forked copy of a process that
    has used it.
    """

    def apply(self, func: Callable[..., Any], computations: Sequence[Any]) -> list[Any]:
        from multiprocessing import get_context

        with get_context("spawn").Pool(self.n_workers) as pool:
            return pool.map(func, computations)


class LinkAnalysis(_base.AnalysisBase):  # type: ignore[misc,name-defined]
    """Verifies the curves of molecules, as :func:`linkwatch.check` does.

    >>> import linkwatch.mdanalysis
    >>> import MDAnalysis
    >>> import numpy as np
    >>> ring = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    >>> other = np.array([[0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1.0]])
    >>> universe = MDAnalysis.Universe.empty(8, trajectory=True)
    >>> frames = [np.concatenate([ring, other + [0.4 * k, 0, 0]]) for k in range(6)]
    >>> _ = universe.load_new(np.array(frames, "f4"), order="fac")
    >>> bonds = [(4 * k + i, 4 * k + (i + 1) % 4) for k in range(2) for i in range(4)]
    >>> universe.add_TopologyAttr("bonds", bonds)
    >>> analysis = linkwatch.mdanalysis.LinkAnalysis(universe).run(stop=5)
    >>> analysis.results.run.verdict, analysis.results.run.changes[0]["frame"]
    ('changed', 3)

    ``run(backend="multiprocessing", n_workers=N)`` and ``backend="dask"`` verify ``n_parts`` parts
    of the trajectory in processes of their own; the result is that of one process, finding by
    finding. Each part begins with the last frame of the previous one, so that the step between them
    is searched for pull-throughs. Parts that depend on what was found before them (new curves,
    jumps through the cell) are verified again, in this process: see
    :mod:`linkwatch.distributed`. Processes are spawned, so a script needs ``if __name__ ==
    "__main__":``. For a cluster of Dask, use ``linkwatch.check(universe, client=client)``.

    Args:
        atoms: a ``Universe`` or ``AtomGroup``: :func:`linkwatch.io.from_mdanalysis` says which
            curves it has. Lengths are in Angstrom.
        closed, unwrap, cell: those of :func:`linkwatch.io.from_mdanalysis`.
        verbose: whether to show a progress bar (with the backend ``"serial"``).
        baseline, events, radius, motion_limit, invariants, wrapped, keep_open: those of
            :func:`linkwatch.check`.

    Attributes:
        results.run: the :class:`linkwatch.Run`, after ``run()``.
        frames, times: number and time (in ps) of each frame, arrays of the shape ``(frames,)``.

    Raises:
        ImportError: MDAnalysis is not installed, with the first use of ``linkwatch.mdanalysis``.
        ValueError: no atoms, no curves, or a frame cannot be read (by ``run``).
    """

    results: Any
    _analysis_algorithm_is_parallelizable = True

    @classmethod
    def get_supported_backends(cls) -> tuple[str, ...]:
        """Returns the backends: ``"serial"``, ``"multiprocessing"`` and ``"dask"``."""
        return "serial", "multiprocessing", "dask"

    def __init__(
        self,
        atoms: Any,
        *,
        closed: bool | None = None,
        unwrap: bool = True,
        cell: Any = None,
        verbose: bool = False,
        **options: Any,
    ) -> None:
        super().__init__(atoms.universe.trajectory, verbose=verbose)
        self._atoms = atoms.atoms
        self._read = {"closed": closed, "unwrap": unwrap, "cell": cell}
        self._options = options_of(**options)
        if closed is False:
            self._options["keep_open"] = True

    def _configure_backend(self, backend: Any, *args: Any, **options: Any) -> Any:
        found = super()._configure_backend(backend, *args, **options)
        return _Spawned(found.n_workers) if backend == "multiprocessing" else found

    def _setup_computation_groups(self, *args: Any, **options: Any) -> Any:
        groups = super()._setup_computation_groups(*args, **options)
        #: Numbers of all frames, so that a part finds the frame before its first one.
        self._numbers = np.concatenate(groups)[:, 1].tolist()
        self._opened: Any = None
        return groups

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_opened": None}

    def _source(self) -> Any:
        """Returns all frames of the run. Each process finds the curves once."""
        if self._opened is None:
            trajectory = self._trajectory[self._numbers]
            self._opened = from_mdanalysis(self._atoms, trajectory=trajectory, **self._read)
        return self._opened

    def _compute(
        self, indexed_frames: Any, verbose: bool | None = None, *, progressbar_kwargs: Any = None
    ) -> Any:
        """Verifies a part of the frames. A single frame would have no step to verify."""
        if not len(indexed_frames):
            return SimpleNamespace(frames=[], times=[], results=_base.Results(parts=[]))
        start, stop = int(indexed_frames[0, 0]), int(indexed_frames[-1, 0]) + 1
        source, before = self._source(), max(start - 1, 0)
        state = distributed._begin(source.part(0, start), self._options) if start else None
        frames = _log.ProgressBar(
            source.part(before, stop),
            total=stop - before,
            verbose=self._verbose if verbose is None else verbose,
            **progressbar_kwargs or {},
        )
        # A part after the first one is verified again if it fails.
        found = distributed._verify(frames, self._options, state, state is not None)
        rows = [] if found[0] is None else found[0].frames
        numbers, times = ([row[key] for row in rows] for key in ("frame", "time"))
        results = _base.Results(parts=[(before, stop, found)])
        return SimpleNamespace(frames=numbers, times=times, results=results)

    def _get_aggregator(self) -> Any:
        group = _base.ResultsGroup
        return group({"parts": group.flatten_sequence})

    def _conclude(self) -> None:
        source: Any = self._source() if self._numbers else None
        merged = distributed.Parts(Run(source, self._options))
        for before, stop, result in self.results.parts:
            merged.add(
                result,
                lambda state: distributed._verify(
                    source.part(before, stop), self._options, state, False
                ),
            )
        self.results = _base.Results(run=merged.run)
