from os import PathLike

from typing import Any, overload

import numpy as np
import numpy.typing as npt

__version__: str

def command(args: list[str]) -> int: ...

class Place:
    segments: tuple[int, int]
    point: tuple[float, float, float]
    distance: float

class Change:
    i: int
    j: int
    image: tuple[int, int, int]
    expected: int
    found: int
    place: Place | None

class PullThrough:
    i: int
    j: int
    image: tuple[int, int, int]
    segments: tuple[int, int]
    fraction: float
    sign: int
    point: tuple[float, float, float]
    lengths: float

class Defect:
    i: int
    j: int | None
    image: tuple[int, int, int]
    kind: str
    place: Place

Point = tuple[float, float, float]

class Strut:
    curves: tuple[int, int]
    segments: tuple[int, int]
    t: tuple[float, float]
    image: tuple[int, int, int]
    points: tuple[Point, Point]
    length: float
    error: float
    gradient: list[list[list[float]]] | None

class Thickness:
    length: float
    min_rad: float | None
    poca: Strut | None
    def thickness(self, stiffness: float = 1.0) -> float: ...
    def ropelength(self, stiffness: float = 1.0) -> float: ...

class Clearance:
    at_least: float
    ratio: float | None
    error: float | None
    curves: tuple[int, int] | None
    segments: list[int] | None
    image: tuple[int, int, int] | None
    points: list[list[float]] | None
    low: bool
    frames_left: float | None

class Ribbon:
    linking: int | None
    twist: float
    twist_error: float
    writhe: float
    writhe_error: float
    passages: int | None
    pairing: str
    pairing_by: str
    rivals: list[tuple[str, float]]

def certify(
    points: npt.NDArray[Any],
    counts: list[int],
    basis_name: str,
    closed_by_default: bool,
    cell_numbers: list[float] | None,
) -> tuple[Certificate, list[str]]: ...
def ribbon(
    points: npt.NDArray[Any],
    counts: list[int],
    strands: tuple[int, int],
    pairing: str,
    axis_first: bool,
    tolerance: float,
) -> Ribbon: ...
def thickness(
    points: npt.NDArray[Any], counts: list[int], basis_name: str, cell: list[float] | None
) -> Thickness: ...
def struts(
    points: npt.NDArray[Any],
    counts: list[int],
    basis_name: str,
    cell: list[float] | None,
    longest: float,
) -> list[Strut]: ...

class Report:
    seq: int
    time: float
    verdict: str
    intact: bool
    abort: bool
    changes: list[Change]
    pull_throughs: list[PullThrough]
    unresolved: list[PullThrough]
    defects: list[Defect]
    appeared: list[str]
    gone: list[str]
    last_intact: int | None
    safe_fraction: float | None
    clearance: Clearance | None
    rejected: str | None
    findings: list[str]
    def __bool__(self) -> bool: ...

class Certificate:
    curves: int
    open: list[int]
    links: list[tuple[int, int, int]]
    images: list[tuple[int, int, tuple[int, int, int], int]] | None
    undefined: list[Defect]
    @staticmethod
    def read(path: str | PathLike[str]) -> Certificate: ...
    def write(self, path: str | PathLike[str]) -> None: ...
    @overload
    def matrix(self) -> npt.NDArray[np.int64]: ...
    @overload
    def matrix(self, *, undefined: float) -> npt.NDArray[np.float64]: ...
    def compare(self, baseline: Certificate) -> list[Change]: ...

class Message:
    kind: str
    seq: int
    time: float
    verdict: str
    intact: bool
    abort: bool
    first: Change | PullThrough | Defect | None
    last_intact: int | None
    safe_fraction: float | None
    appeared: int
    gone: int
    findings: int
    recovered: int
    rejected: str | None

class Client:
    is_open: bool
    def __init__(
        self,
        service: str,
        curves: tuple[list[int], list[str], list[float]],
        basis_name: str,
        single: bool,
        lockstep: bool,
        wait_mode: str,
    ) -> None: ...
    def describe(self, curves: tuple[list[int], list[str], list[float]]) -> None: ...
    def set_time_step(self, seconds: float) -> None: ...
    def set_cell(self, numbers: list[float]) -> None: ...
    def begin(self, time: float) -> npt.NDArray[Any]: ...
    def publish(self) -> int: ...
    def poll(self) -> Message | None: ...
    def wait(self, seconds: float) -> Message | None: ...
    @property
    def no_verdict(self) -> str | None: ...
    def wait_for_watcher(self, seconds: float) -> bool: ...
    def aborted(self) -> Message | None: ...
    def resume(self) -> None: ...
    def accept(self) -> None: ...
    def cut(self) -> None: ...
    def silent_for(self) -> float | None: ...
    def finish(self, seconds: float) -> Message | None: ...
    def close(self) -> None: ...

class Session:
    def __init__(
        self,
        *,
        basis_name: str,
        baseline: Certificate | None,
        events: str,
        abort_on: str,
        flags: tuple[bool, bool, bool | None],
        motion_limit: float | None,
        strands: tuple[float | None, float] | None,
    ) -> None: ...
    def describe(self, names: list[str], radii: list[float], closed_by_default: bool) -> None: ...
    def set_cell(self, numbers: list[float]) -> None: ...
    def step(self, points: npt.NDArray[Any], counts: list[int], time: float) -> Report: ...
    def cut(self) -> None: ...
    def accept(self) -> None: ...
    def jumps(self) -> int: ...
    def unmeasured_clearance(self) -> str | None: ...
    def notes(self) -> list[str]: ...
    def open(self) -> list[int]: ...
    def baseline(self) -> Certificate | None: ...
