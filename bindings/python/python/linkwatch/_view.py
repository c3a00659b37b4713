"""Frames of a run in the rerun viewer."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import numpy as np

from .io._frames import library

if TYPE_CHECKING:
    import os
    from typing import Any

    import numpy.typing as npt

    from ._run import Run
    from .io._frames import Frame

#: Colours of curves without findings, of those of a finding, and of pull-throughs.
QUIET, RED, CYAN = (110, 125, 148), (255, 59, 48), (62, 214, 255)
BACKGROUND = (15, 19, 24)
#: Weights of four control points, by powers of the parameter.
SPLINES = {
    "catmull-rom": np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]]) / 2,
    "b-spline": np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6,
    "bezier": np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]),
}
#: Number of edges of a spline segment.
SAMPLES = 6


def strips(frame: Frame) -> list[npt.NDArray[Any]]:
    """Returns the points to draw of each curve."""
    drawn, start = [], 0
    for count in frame.counts:
        closed, n = count < 0, abs(count)
        points = frame.positions[start : start + n]
        start += n
        step = 3 if frame.basis == "bezier" else 1
        if frame.basis == "polyline":
            drawn.append(np.concatenate([points, points[:1]]) if closed else points)
            continue
        first = np.arange(0, n if closed else n - 3, step)
        windows = points[(first[:, None] + np.arange(4)) % n]
        powers = np.linspace(0, 1, SAMPLES + 1)[:, None] ** np.arange(4)
        weights = powers @ SPLINES[frame.basis]
        drawn.append(np.einsum("tk,skx->stx", weights, windows).reshape(-1, 3))
    return drawn


def view(run: Run, path: str | os.PathLike[str] | None) -> None:
    """Logs the frames of a run, see :meth:`Run.view`."""
    if run.source is None or run.source.kind == "once":
        raise ValueError("the frames cannot be read again: check a file, or a list of frames")
    rerun = library("rerun", "viewer", "a viewer")
    inline = path is None and "ipykernel" in sys.modules
    blueprint = library("rerun.blueprint", "viewer", "a viewer")
    recording = rerun.RecordingStream("linkwatch-python")
    if path is not None:
        recording.save(path)
    elif not inline:
        recording.spawn()
    scene = blueprint.Spatial3DView(
        contents=["/curves", "/pull-throughs"],
        name="curves",
        background=blueprint.Background(color=BACKGROUND, kind="SolidColor"),
        line_grid=blueprint.LineGrid3D(visible=False),
    )
    views = blueprint.Vertical(scene, blueprint.TextLogView(origin="/log"), row_shares=[4, 1])
    recording.send_blueprint(blueprint.Blueprint(views, collapse_panels=True))
    for frame in run.source:
        if frame.rejected is not None:
            continue
        recording.set_time("frame", sequence=frame.seq)
        lasting = [row for row in run.changes if row["frame"] <= frame.seq <= row["last"]]
        passed = [row for row in run.pull_throughs if row["frame"] == frame.seq]
        red = {row[k] for row in lasting + passed for k in "ij"}
        colors = [RED if k in red else QUIET for k in range(len(frame.counts))]
        curves = rerun.LineStrips3D(
            strips(frame), colors=colors, labels=frame.names or None, show_labels=False
        )
        recording.log("curves", curves)
        places = [row["point"] for row in passed]
        recording.log("pull-throughs", rerun.Points3D(places, colors=CYAN, radii=-6.0))
        verdict = next((row["verdict"] for row in run.frames if row["frame"] == frame.seq), "")
        level = "INFO" if verdict == "intact" else "ERROR"
        recording.log("log", rerun.TextLog(f"frame {frame.seq}: {verdict}", level=level))
    recording.flush()
    if inline:
        rerun.notebook_show(recording=recording)
