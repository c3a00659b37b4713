"""Checks of arguments: every wrong one is an exception that names it and what was expected."""

from __future__ import annotations

import operator
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from typing import Any

    import numpy.typing as npt

    from .io import Frame as FileFrame

    Frame = Sequence[npt.ArrayLike] | npt.NDArray[Any]
    Counts = Sequence[int] | npt.NDArray[Any]
    Closed = bool | Sequence[bool]
    Cell = npt.ArrayLike

# Largest number of points of a curve.
MOST_POINTS = 2**31 - 1

# Largest magnitude up to which all integers are exact in double precision.
EXACT = 2**53


def _shown(value: object) -> str:
    """Returns a value in few words."""
    kind, text = type(value).__name__, repr(value)
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return f"an array of the shape {value.shape} and the type {value.dtype}"
    return f"{text} ({kind})" if len(text) <= 40 else f"a {kind}"


def _items(name: str, value: Any, expected: str) -> list[Any]:
    """Returns the items of a sequence, which is no text."""
    if not isinstance(value, (str, bytes, dict, set, frozenset)):
        try:
            return list(value)
        except TypeError:
            pass
    raise TypeError(f"{name} is {_shown(value)}, expected {expected}")


def number(name: str, value: Any, expected: str = "a number") -> float:
    """Returns a real number, which may be infinite or NaN."""
    if type(value) is float:
        return value
    import numpy as np

    if not isinstance(value, (str, bytes, bool, np.bool_, np.ma.MaskedArray)):
        try:
            if np.ndim(value) == 0 and not np.iscomplexobj(value):
                return float(value)
        except (TypeError, ValueError, OverflowError):
            pass
    raise TypeError(f"{name} is {_shown(value)}, expected {expected}")


def tolerance(value: Any) -> float:
    """Returns the largest error of an integral."""
    found = number("tolerance", value, "a number above 0")
    if not found > 0:
        raise ValueError(f"tolerance is {found}, expected a number above 0")
    return found


def word(name: str, value: Any, expected: str) -> str:
    """Returns a text."""
    if not isinstance(value, str):
        raise TypeError(f"{name} is {_shown(value)}, expected {expected}")
    return value


def flag(name: str, value: Any) -> bool:
    """Returns a boolean."""
    import numpy as np

    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} is {_shown(value)}, expected True or False")
    return bool(value)


def flag_or_none(name: str, value: Any) -> bool | None:
    """Returns a boolean, or ``None``."""
    return None if value is None else flag(name, value)


def words(name: str, value: Any) -> list[str]:
    """Returns a text for each curve."""
    items = _items(name, value, "a sequence of texts, one for each curve")
    return [word(f"{name}[{i}]", item, "a text") for i, item in enumerate(items)]


def numbers(name: str, value: Any) -> list[float]:
    """Returns a number for each curve."""
    items = _items(name, value, "a sequence of numbers, one for each curve")
    return [number(f"{name}[{i}]", item) for i, item in enumerate(items)]


def indices(name: str, value: Any, curves: int) -> tuple[int, int]:
    """Returns two different curves of a frame."""
    expected = f"two different curves of 0 to {curves - 1}"
    found = _items(name, value, expected)
    try:
        first, second = (operator.index(item) for item in found)
    except (TypeError, ValueError):
        raise TypeError(f"{name} is {_shown(value)}, expected {expected}") from None
    if first == second or not (0 <= first < curves and 0 <= second < curves):
        raise ValueError(f"{name} is {_shown(value)}, expected {expected}")
    return first, second


def integers(counts: Any) -> list[int]:
    """Returns the counts of curves as a list."""
    found = []
    expected = "a sequence of integers: the number of points of each curve, negative if closed"
    for i, count in enumerate(_items("counts", counts, expected)):
        try:
            if isinstance(count, bool):
                raise TypeError
            found.append(operator.index(count))
        except TypeError:
            shown = _shown(count)
            raise TypeError(f"counts[{i}] is {shown}, expected an integer") from None
        if abs(found[-1]) > MOST_POINTS:
            raise ValueError(f"counts[{i}] is {count}, expected at most {MOST_POINTS} points")
    return found


def _array(name: str, value: Any) -> npt.NDArray[Any]:
    """Returns the points of a curve, or of all, as an array of the shape ``(n, 3)``."""
    import numpy as np

    expected = "expected numbers of the shape (n, 3)"
    if np.ma.is_masked(value):
        raise ValueError(f"{name} has masked points: fill or remove them")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, RuntimeError) as why:
        raise type(why)(f"{name}: {why}; {expected}") from None
    if array.ndim != 2 or array.shape[1] != 3:
        if array.ndim == 0:
            raise TypeError(f"{name} is {_shown(value)}, {expected}")
        raise ValueError(f"{name} has the shape {array.shape}, expected (n, 3)")
    kind = array.dtype
    if kind.kind not in "iuf" or (kind.kind == "f" and kind.itemsize not in (4, 8)):
        raise ValueError(f"{name} has the type {kind}, expected float32 or float64")
    if kind.kind in "iu" and kind.itemsize == 8 and array.size:
        if max(abs(int(array.min())), abs(int(array.max()))) > EXACT:
            raise ValueError(f"{name} has integers beyond 2**53, which float64 would round")
    return array


def is_run(value: Any) -> bool:
    """Returns if an argument has frames instead of curves."""
    kinds = (str, os.PathLike, Iterator)
    return isinstance(value, kinds) or hasattr(value, "universe") or hasattr(value, "summary")


def frame(
    curves: Any, counts: list[int] | None, closed: Any, name: str = "curves"
) -> tuple[npt.NDArray[Any], list[int]]:
    """Returns the points of all curves as one array, and the counts."""
    # Here, so that importing the package takes no time.
    import numpy as np

    if counts is None:
        if isinstance(curves, np.ndarray) and curves.ndim == 2:
            raise ValueError(
                f"{name} is one array of points, which needs counts: the number of points of each "
                "curve"
            )
        expected = "a sequence of arrays of the shape (n, 3), or one array (N, 3) and counts"
        prefix = "" if name == "curves" else f"{name}: "
        items = enumerate(_items(name, curves, expected))
        arrays = [_array(f"{prefix}curve {i}", curve) for i, curve in items]
        if not arrays:
            raise ValueError(f"{name}: the frame holds no curves")
        flags = _flags(closed, len(arrays))
        counts = [-len(array) if flag else len(array) for array, flag in zip(arrays, flags)]
        types = {array.dtype for array in arrays if array.dtype.kind == "f"}
        if len(types) > 1:
            names = ", ".join(sorted(map(str, types)))
            raise ValueError(f"{prefix}curves have different types: {names}")
        points = np.concatenate(arrays)
    else:
        points = _array(name, curves)
        if closed is not None:
            _agree(counts, _flags(closed, len(counts)))
    kind = np.dtype(np.float32 if points.dtype.type is np.float32 else np.float64)
    # Arrays that Dask received may be misaligned.
    if points.dtype != kind or not (points.flags.c_contiguous and points.flags.aligned):
        points = np.require(points, kind, ["C", "A"])
    return points, counts


def _flags(closed: Any, curves: int) -> list[bool]:
    """Returns for each curve if it is closed."""
    import numpy as np

    if closed is None or isinstance(closed, (bool, np.bool_)):
        return [closed is None or bool(closed)] * curves
    expected = "True, False, or a sequence of them, one for each curve"
    flags = [flag(f"closed[{i}]", c) for i, c in enumerate(_items("closed", closed, expected))]
    if len(flags) != curves:
        raise ValueError(f"closed has {len(flags)} values for {curves} curves")
    return flags


def _agree(counts: list[int], flags: Iterable[bool]) -> None:
    """Raises an exception if the sign of a count contradicts the flag of its curve."""
    for i, (count, flag) in enumerate(zip(counts, flags)):
        if flag != (count < 0):
            state = "open" if count >= 0 else "closed"
            raise ValueError(
                f"closed says {flag} of curve {i}, but counts[{i}] is {count}: a negative count is "
                f"a closed curve, so this one is {state}. Give one of the two"
            )


def twelve(cell: Any) -> list[float]:
    """Returns twelve numbers: the lattice vectors of a cell and its corner."""
    import numpy as np

    expected = "expected 3 edges, 3 vectors (3, 3), or these and a corner (4, 3)"
    try:
        given = np.asarray(cell)
    except (TypeError, ValueError, RuntimeError) as why:
        raise type(why)(f"cell: {why}; {expected}") from None
    if given.ndim and given.dtype.kind not in "iuf":
        raise TypeError(f"cell has the type {given.dtype}, {expected}, all numbers")
    if np.ma.is_masked(cell):
        raise ValueError(f"cell has masked numbers, {expected}")
    if given.shape == (3,):
        given = np.diag(given)
    if given.shape not in ((9,), (12,), (3, 3), (4, 3)):
        raise ValueError(f"cell has the shape {given.shape}, {expected}")
    found: list[float] = given.astype(np.float64).ravel().tolist()
    return found + [0.0] * (12 - len(found))


def raw(of: FileFrame) -> tuple[npt.NDArray[Any], list[int], str, list[float] | None]:
    """Returns a frame of a file as the compiled functions take it."""
    points, counts = frame(of.positions, of.counts, None)
    return points, counts, of.basis, None if of.cell is None else twelve(of.cell)
