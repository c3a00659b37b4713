"""Lines of meshes: VTK files (legacy and XML), PLY, and the formats of ``meshio``."""

from __future__ import annotations

import base64
import contextlib
import io
import lzma
import re
import zlib
from itertools import takewhile
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from ._curves import Curve, Scene, curves_of_edges, frames_of_files, frames_of_scenes
from ._frames import library

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path
    from typing import Any

    from ._curves import Array, Options
    from ._frames import Frames

# Types of cells of VTK: edges and polylines are read, other curves are counted.
LINE, POLYLINE = 3, 4
CURVED = {
    21: "quadratic edge",
    35: "cubic line",
    68: "Lagrange curve",
    75: "Bezier curve",
}
# Names of arrays by which finite elements displace the points.
DISPLACEMENTS = {*"depl disp displ displacement displacements".split()}
# Vectors at the points of a legacy file.
VECTORS = re.compile(rb"^\s*(?:VECTORS\s+(\S+)\s+\S+|(\S+)\s+3\s+\d+\s+\S+)\s*$", re.I | re.M)
# Types of XML files.
READ = ("PolyData", "UnstructuredGrid", "PPolyData", "PUnstructuredGrid", "vtkMultiBlockDataSet")
# Types of arrays in legacy and in XML files.
TYPES = {
    "char": "i1", "unsigned_char": "u1", "short": "i2", "unsigned_short": "u2", "int": "i4",
    "unsigned_int": "u4", "long": "i8", "unsigned_long": "u8", "float": "f4", "double": "f8",
    "vtktypeint64": "i8", "vtkidtype": "i8", "bit": "u1",
    **{f"{sign}Int{8 * n}": f"{kind}{n}" for sign, kind in (("", "i"), ("U", "u")) for n in
       (1, 2, 4, 8)},
    "Float32": "f4", "Float64": "f8",
}  # fmt: skip


def _lines(scene: Scene, points: Array, lines: Sequence[Array]) -> Scene:
    """Adds polylines, which are lists of points, and joins those that share ends."""
    edges = []
    for k, line in enumerate(lines):
        if len(line) and not 0 <= line.min() <= line.max() < len(points):
            raise ValueError(f"{scene.place}: line {k} has points beyond the {len(points)} points")
    for k, line in _joined(scene, lines):
        if len(line) == 2:
            edges.append(line)
        elif len(line) < 2:
            scene.left_out.add("line(s) of one point", f"line {k}")
        else:
            closed = bool(line[0] == line[-1])
            if closed and len(line) < 4:
                many = "lines that return after two points"
                scene.left_out.add("line that returns after two points", f"line {k}", many=many)
                continue
            scene.curves.append(Curve(points[line[: len(line) - closed]], closed))
    if edges:
        joined = np.array(edges, np.int64)
        # Places tell which edges meet that share no point with another one.
        alone = (np.bincount(joined.ravel())[joined] == 1).all(axis=1)
        ends = joined[alone].ravel()
        _, first, same = np.unique(points[ends], axis=0, return_index=True, return_inverse=True)
        if len(first) < len(ends):
            scene.notes.append("edges whose ends have equal coordinates are joined")
            # The first ones of equal points: their order does not depend on coordinates.
            joined[alone] = ends[first[same]].reshape(-1, 2)
        curves_of_edges(points, joined, scene, "edges")
    return scene


def _note_vectors(scene: Scene, names: Iterable[str]) -> None:
    """Counts the vectors at points that may displace these."""
    for name in names:
        if name.lower() in DISPLACEMENTS:
            scene.left_out.add("array(s) that may displace the points", name)


def _joined(scene: Scene, lines: Sequence[Array]) -> list[tuple[int, Array]]:
    """Joins polylines with the lines that continue them. Returns the number of the first line of
    each, and its points. A line with a point that a third one has, or an inner point that another
    one has, is not joined."""
    if not any(len(line) > 2 for line in lines):
        return list(enumerate(lines))
    lines = [line.astype(np.int64) for line in lines]
    uses = np.bincount(np.concatenate([np.empty(0, np.int64), *lines]))

    def is_simple(line: Array) -> bool:
        is_open = len(line) > 1 and line[0] != line[-1]
        return is_open and bool((uses[line[1:-1]] == 1).all() and (uses[line[[0, -1]]] < 3).all())

    free = [is_simple(line) for line in lines]
    taken: set[int] = set()
    at: dict[int, list[int]] = {}
    for k, line in enumerate(lines):
        for end in line[[0, -1]].tolist() if free[k] else ():
            at.setdefault(end, []).append(k)

    def extended(line: Array) -> Array:
        """Adds what continues the last point of a line, up to its first one."""
        parts = [line]
        while (end := int(parts[-1][-1])) != line[0]:
            following = [k for k in at[end] if free[k]]
            if not following:
                break
            other = lines[following[0]]
            free[following[0]] = False
            taken.add(following[0])
            parts.append((other if other[0] == end else other[::-1])[1:])
        return np.concatenate(parts)

    longer = {}
    for k, line in enumerate(lines):
        if free[k] and len(line) > 2:
            free[k] = False
            longer[k] = extended(extended(line)[::-1])[::-1]
    if taken:
        scene.notes.append("lines that share an end are joined")
    return [(k, longer.get(k, line)) for k, line in enumerate(lines) if k not in taken]


def read_vtk(path: Path) -> Scene:
    """Reads a legacy VTK file of the kinds POLYDATA and UNSTRUCTURED_GRID."""
    file = _Legacy(path)
    scene = Scene(place=str(path))
    found: dict[str, Any] = {"POINTS": np.empty((0, 3)), "CELL_TYPES": np.empty(0, int)}
    while (words := file.line()) is not None:
        key = words[0].upper()
        try:
            if key == "POINTS":
                found[key] = file.array(3 * file.size(words[1]), words[2]).reshape(-1, 3)
            elif key in ("LINES", "VERTICES", "POLYGONS", "TRIANGLE_STRIPS", "CELLS"):
                found[key] = file.cells(file.size(words[1]), file.size(words[2]))
            elif key == "CELL_TYPES":
                found[key] = file.array(file.size(words[1]), "int")
            elif key == "FIELD":
                for name, values in file.fields(file.size(words[2])):
                    if name.upper() in ("TIME", "TIMEVALUE") and len(values):
                        scene.time = float(values[0])
            elif key == "METADATA":
                file.skip_metadata()
            elif key in ("POINT_DATA", "CELL_DATA"):
                found_names = VECTORS.findall(file.data, file.at)
                _note_vectors(scene, (b"".join(name).decode("latin-1") for name in found_names))
                break
            else:
                raise file.error(f"section {words[0]}: POLYDATA and UNSTRUCTURED_GRID are read")
        except IndexError:
            raise file.error("the line is incomplete") from None
    cells = _cells_with_lines(scene, found.get("CELLS", []), found["CELL_TYPES"])
    return _lines(scene, found["POINTS"], found.get("LINES") or cells)


def _cells_with_lines(scene: Scene, cells: Sequence[Array], kinds: Array) -> list[Array]:
    """Returns the cells that are lines, and counts other curves."""
    if len(cells) != len(kinds):
        raise ValueError(f"{scene.place}: {len(cells)} cells, but {len(kinds)} types of cells")
    for kind, name in CURVED.items():
        found = np.flatnonzero(kinds == kind)
        if len(found):
            scene.left_out.add(f"{name}(s)", f"cell {found[0]}", len(found))
    return [cell for cell, kind in zip(cells, kinds) if kind in (LINE, POLYLINE)]


class _Legacy:
    """A legacy VTK file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.data = path.read_bytes()
        self.at = 0
        self.number = 0
        first, _, kind = self._text(), self._text(), self._text().strip().upper()
        if not first.startswith("# vtk DataFile") or kind not in ("ASCII", "BINARY"):
            raise ValueError(f"{path}: not a legacy VTK file")
        self.binary = kind == "BINARY"
        words = self.line() or [""]
        if words[0].upper() != "DATASET" or words[-1].upper() not in (
            "POLYDATA",
            "UNSTRUCTURED_GRID",
        ):
            raise self.error(f"{' '.join(words)}: POLYDATA and UNSTRUCTURED_GRID have lines")

    def error(self, why: str) -> ValueError:
        where = f"byte {self.at}" if self.binary else f"line {self.number}"
        return ValueError(f"{self.path}, {where}: {why}")

    def _text(self) -> str:
        end = self.data.find(b"\n", self.at)
        end = len(self.data) if end < 0 else end
        text = self.data[self.at : end].decode("latin-1")
        self.at = end + 1
        self.number += 1
        return text

    def line(self) -> list[str] | None:
        """Returns the words of the next line that is not empty."""
        while self.at < len(self.data):
            words = self._text().split()
            if words:
                return words
        return None

    def size(self, word: str) -> int:
        """Returns a number of elements, which cannot be larger than the file."""
        if not word.isdigit() or int(word) > len(self.data):
            raise self.error(f"{word} elements in a file of {len(self.data)} bytes")
        return int(word)

    def array(self, number: int, kind: str) -> Array:
        """Reads numbers."""
        if kind.lower() not in TYPES:
            raise self.error(f"type {kind}")
        dtype = np.dtype(TYPES[kind.lower()])
        if self.binary:
            start, self.at = self.at, self.at + number * dtype.itemsize
            if self.at > len(self.data):
                raise self.error(f"the file ends before {number} numbers")
            values = np.frombuffer(self.data, dtype.newbyteorder(">"), number, start)
            if self.data[self.at : self.at + 1] == b"\n":
                self.at += 1
            return values.astype(dtype)
        words: list[str] = []
        while len(words) < number:
            more = self.line()
            if more is None:
                raise self.error(f"the file ends after {len(words)} of {number} numbers")
            words += more
        try:
            # Decimals are read in double precision, and written ones in the file's precision.
            return np.array(words, float if dtype.kind == "f" else np.int64)
        except ValueError as why:
            raise self.error(str(why)) from None

    def cells(self, number: int, size: int) -> list[Array]:
        """Reads lists of points: with a count before each, or, from version 5.1 on, offsets."""
        start, line = self.at, self.number
        words = self.line() or [""]
        if words[0].upper() == "OFFSETS":
            offsets = self.array(number, words[1])
            words = self.line() or [""]
            points = self.array(size, words[-1])
            return _split(self.error, points, offsets[1:])
        self.at, self.number = start, line
        flat = self.array(size, "int")
        found: list[Array] = []
        at = 0
        for _ in range(number):
            n = int(flat[at]) if at < size else -1
            if n < 0 or at + n >= size:
                raise self.error(f"{size} numbers do not hold {number} cells")
            found.append(flat[at + 1 : at + 1 + n])
            at += n + 1
        return found

    def fields(self, number: int) -> Iterator[tuple[str, Array]]:
        """Yields names and values of arrays."""
        for _ in range(number):
            words = self.line() or []
            while words[:1] == ["METADATA"]:
                self.skip_metadata()
                words = self.line() or []
            if len(words) != 4:
                raise self.error(f"expected name, components, tuples and type: {' '.join(words)}")
            size = self.size(words[1]) * self.size(words[2])
            if words[3].lower() == "string":
                self._skip_strings(size)
            else:
                yield words[0], self.array(size, words[3])

    def _skip_strings(self, number: int) -> None:
        """Skips strings, each in a line or after its length."""
        for _ in range(number):
            if not self.binary:
                self._text()
                continue
            # Two bits tell the number of bytes that the length has with them.
            width = 8 >> (self.data[self.at] >> 6) if self.at < len(self.data) else 1
            length = int.from_bytes(self.data[self.at : self.at + width], "big")
            self.at += width + length % (1 << (8 * width - 2))
        if self.binary and self.data[self.at : self.at + 1] == b"\n":
            self.at += 1

    def skip_metadata(self) -> None:
        """Skips lines up to an empty one."""
        while self.at < len(self.data) and self._text().strip():
            pass


def _split(error: Callable[[str], ValueError], points: Array, ends: Array) -> list[Array]:
    """Returns the lists of points that end at some places."""
    if len(ends) and (ends[0] < 0 or (np.diff(ends) < 0).any() or ends[-1] != len(points)):
        raise error("offsets that do not fit the connectivity")
    return np.split(points, ends[:-1]) if len(ends) else []


def _pieces(path: Path, *above: Path) -> Iterator[tuple[_Xml, ElementTree.Element]]:
    """Yields the pieces of a file and of the files it includes. `above` include it."""
    file = _Xml(path)
    if path.resolve() in above:
        raise file.error("the file names itself, or a file that names it")
    for one in file.root.iter():
        source = {"Piece": one.get("Source"), "DataSet": one.get("file")}.get(one.tag)
        if source:
            yield from _pieces(path.parent / source, path.resolve(), *above)
        elif one.tag == "Piece":
            yield file, one


def read_xml(path: Path) -> Scene:
    """Reads the lines of a ``.vtp`` or ``.vtu`` file, or of the files of its parts (``.pvtp``,
    ``.pvtu``) or blocks (``.vtm``)."""
    scene = Scene(place=str(path))
    if path.suffix.lower() in (".pvtp", ".pvtu"):
        scene.notes.append("curves that continue in another part are cut there")
    points: list[Array] = []
    lines: list[Array] = []
    shift = 0
    for file, piece in _pieces(path):
        found = file.arrays(piece.find("Points"))
        here = next(iter(found.values()), np.empty(0)).reshape(-1, 3)
        for section in ("Lines", "Cells"):
            arrays = file.arrays(piece.find(section))
            if not arrays:
                continue
            if not {"connectivity", "offsets"} <= arrays.keys():
                raise file.error(f"{section} without the arrays connectivity and offsets")
            cells = _split(file.error, arrays["connectivity"], arrays["offsets"])
            if section == "Cells":
                kinds = arrays.get("types", np.empty(0, int))
                cells = _cells_with_lines(scene, cells, kinds)
            if any(len(cell) and not 0 <= cell.min() <= cell.max() < len(here) for cell in cells):
                raise file.error(f"{section} have points beyond the {len(here)} of the piece")
            lines += [cell.astype(np.int64) + shift for cell in cells]
        points.append(here)
        shift += len(here)
        vectors = piece.iterfind("PointData/DataArray[@NumberOfComponents='3']")
        _note_vectors(scene, (one.get("Name") or "" for one in vectors))
    file = _Xml(path)
    for array in file.root.iter("DataArray"):
        if (array.get("Name") or "").lower() == "timevalue":
            scene.time = float(next(iter(file.array(array)), scene.time))
    return _lines(scene, np.concatenate(points) if points else np.empty((0, 3)), lines)


class _Xml:
    """An XML file of VTK."""

    def __init__(self, path: Path) -> None:
        self.path = path
        data = path.read_bytes()
        head, mark, tail = data.partition(b"<AppendedData")
        self.appended = b""
        raw = re.search(rb"""encoding\s*=\s*["']raw["']""", tail.partition(b">")[0]) is not None
        if mark:
            # Raw bytes are no XML.
            self.appended = tail[tail.find(b"_") + 1 :]
            head += b"</VTKFile>"
        try:
            self.root = ElementTree.fromstring(head)
        except ElementTree.ParseError as why:
            raise self.error(f"not a valid VTK file: {why}") from None
        if self.root.tag != "VTKFile":
            raise self.error(f"not a VTK file, but {self.root.tag}")
        kind = self.root.get("type")
        if kind not in READ:
            raise self.error(f"type {kind}; PolyData and UnstructuredGrid are read")
        if mark and not raw:
            self.appended = self.appended.split(b"<")[0].strip()
        self.raw = raw
        self.order = ">" if self.root.get("byte_order") == "BigEndian" else "<"
        header = self.root.get("header_type", "UInt32")
        if header not in ("UInt32", "UInt64"):
            raise self.error(f"header_type {header}")
        self.header = np.dtype(self.order + TYPES[header])
        self.compressor = self.root.get("compressor", "")

    def error(self, why: str) -> ValueError:
        return ValueError(f"{self.path}: {why}")

    def arrays(self, section: Any) -> dict[str, Array]:
        """Returns the arrays of a section by name."""
        found = [] if section is None else section.findall("DataArray")
        return {array.get("Name") or str(k): self.array(array) for k, array in enumerate(found)}

    def array(self, element: Any) -> Array:
        """Returns the values of an array."""
        kind, form = TYPES.get(element.get("type", "")), element.get("format", "ascii")
        name = f"array {element.get('Name')}"
        if kind is None:
            raise self.error(f"{name} of type {element.get('type')}")
        text = element.text or ""
        try:
            if form == "ascii":
                return np.array(text.split(), float if kind[0] == "f" else np.int64)
            if form == "appended":
                offset = int(element.get("offset", 0))
                if offset < 0:
                    raise ValueError(f"offset {offset}")
                data = self.appended[offset:]
                found = self._decoded(data, self.raw)
            else:
                found = self._decoded("".join(text.split()).encode(), False)
            return np.frombuffer(found, self.order + kind).astype(kind)
        except (ValueError, OverflowError, RuntimeError, zlib.error, lzma.LZMAError) as why:
            raise self.error(f"{name}: {why}") from None

    def _decoded(self, data: bytes, raw: bool) -> bytes:
        """Returns the bytes of an array, which follow a header with their number."""
        width = self.header.itemsize

        def take(start: int, number: int) -> bytes:
            """Returns bytes from a position on. In base64, it is that of a character at which an
            encoded part begins."""
            if raw:
                part = data[start : start + number]
            else:
                part = base64.b64decode(data[start : start + 4 * -(-number // 3)])[:number]
            if len(part) < number:
                raise ValueError(f"{len(part)} of {number} bytes")
            return part

        def numbers(count: int) -> list[int]:
            return [int(n) for n in np.frombuffer(take(0, count * width), self.header)]

        if not self.compressor:
            return take(0, width + numbers(1)[0])[width:]
        blocks = numbers(1)[0]
        if blocks > len(data):
            raise ValueError(f"{blocks} blocks in {len(data)} bytes")
        _, full, last, *sizes = numbers(3 + blocks)
        head = (3 + blocks) * width
        packed = take(head if raw else 4 * -(-head // 3), sum(sizes))
        unpack = self._unpack()
        found, at = [], 0
        for k, size in enumerate(sizes):
            expected = last if last and k == blocks - 1 else full
            found.append(unpack(packed[at : at + size], expected))
            if len(found[-1]) != expected:
                raise ValueError(f"block {k} has {len(found[-1])} bytes, expected {expected}")
            at += size
        return b"".join(found)

    def _unpack(self) -> Callable[[bytes, int], bytes]:
        """Returns the function that unpacks a block, given the number of its bytes."""
        if self.compressor == "vtkZLibDataCompressor":
            return lambda data, size: zlib.decompressobj().decompress(data, size + 1)
        if self.compressor == "vtkLZMADataCompressor":
            return lambda data, size: lzma.LZMADecompressor().decompress(data, size + 1)
        if self.compressor == "vtkLZ4DataCompressor":
            lz4 = library("lz4.block", "mesh")
            return lambda data, size: bytes(lz4.decompress(data, uncompressed_size=size))
        raise ValueError(f"compressor {self.compressor}; write it with zlib")


def read_pvd(paths: Sequence[Path], options: Options) -> Frames:
    """Opens a ``.pvd`` collection of ParaView, whose files are frames with times."""
    if len(paths) != 1:
        raise ValueError(f"{len(paths)} collections: give one .pvd file")
    path = paths[0]
    try:
        found = list(ElementTree.parse(path).getroot().iter("DataSet"))
        sets = [(float(one.attrib["timestep"]), path.parent / one.attrib["file"]) for one in found]
    except (ElementTree.ParseError, KeyError, ValueError) as why:
        raise ValueError(f"{path}: not a valid collection: {why}") from None
    if len({time for time, _ in sets}) < len(sets):
        raise ValueError(f"{path}: several files of one time; merge their parts into one")

    def scenes() -> Iterator[Scene]:
        for time, one in sorted(sets):
            scene = read_xml(one)
            scene.time = time
            yield scene

    return frames_of_scenes(path, scenes, options, len(sets))


def read_ply(path: Path) -> Scene:
    """Reads the elements ``edge`` of a PLY file."""
    scene = Scene(place=str(path))
    elements = {name: (rows, lists) for name, rows, lists in _elements(path)}
    if "vertex" not in elements:
        raise ValueError(f"{path}: no element vertex")
    vertices = elements["vertex"][0]
    points = _columns(path, vertices, "vertex", ("x", "y", "z"))
    for name, (_, lists) in elements.items():
        if name not in ("vertex", "edge", "face", "tristrips", "material", "camera") and lists:
            scene.left_out.add(f"element(s) with lists of points ({name})", f"{name} 0", lists)
    if "edge" not in elements:
        return scene
    edges = elements["edge"][0]
    names = ("vertex1", "vertex2")
    if "v1" in edges:
        names = ("v1", "v2")
    ends = _columns(path, edges, "edge", names).astype(np.int64)
    return _lines(scene, points, list(ends))


def _columns(path: Path, rows: Any, element: str, names: Sequence[str]) -> Array:
    """Returns properties of all elements of a kind."""
    missing = [name for name in names if name not in rows]
    if missing:
        raise ValueError(f"{path}: element {element} without property {missing[0]}")
    return np.stack([rows[name] for name in names], axis=1)


# Types of properties of PLY.
PLY_TYPES = {
    **{f"{sign}int{8 * n}": f"{kind}{n}" for sign, kind in (("", "i"), ("u", "u")) for n in
       (1, 2, 4)},
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip


def _elements(path: Path) -> Iterator[tuple[str, dict[str, Array], int]]:
    """Yields name, properties, and the number of elements with lists, of each kind of elements."""
    data = path.read_bytes()
    head, mark, body = data.partition(b"end_header")
    lines = [line.split() for line in head.decode("latin-1").splitlines()]
    if not mark or lines[0] != ["ply"]:
        raise ValueError(f"{path}: not a PLY file: no header from `ply` to `end_header`")
    body = body[body.find(b"\n") + 1 :]
    form = next((words[1] for words in lines if words[:1] == ["format"] and words[1:]), "")
    orders = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
    if form not in orders:
        raise ValueError(f"{path}: format {form!r}")
    kinds: list[tuple[str, int, list[list[str]]]] = []
    for number, words in enumerate(lines, 1):
        try:
            if words[:1] == ["element"]:
                kinds.append((words[1], int(words[2]), []))
                if not 0 <= kinds[-1][1] <= len(body):
                    raise ValueError
            elif words[:1] == ["property"]:
                # Name, type, and for lists the type of their number.
                types = [PLY_TYPES[word] for word in words[1 + (words[1] == "list") : -1]]
                if len(types) != 1 + (words[1] == "list"):
                    raise ValueError
                kinds[-1][2].append([words[-1], *types])
        except (IndexError, KeyError, ValueError):
            raise ValueError(f"{path}, line {number}: {' '.join(words)}") from None
    order, at = orders[form], 0
    text = body.decode("latin-1").splitlines() if not order else []
    for name, count, properties in kinds:
        lists = any(len(one) == 3 for one in properties)
        try:
            if not order:
                rows = [line.split() for line in text[at : at + count]]
                at += count
                if len(rows) < count:
                    raise ValueError(f"{len(rows)} of {count} elements")
                found = {} if lists else _text_columns(rows, properties)
            elif lists:
                for _ in range(count):
                    for one in properties:
                        if len(one) == 2:
                            at += np.dtype(one[1]).itemsize
                            continue
                        n = int(np.frombuffer(body, order + one[1], 1, at)[0])
                        at += np.dtype(one[1]).itemsize + n * np.dtype(one[2]).itemsize
                found = {}
            else:
                dtype = np.dtype([(one[0], order + one[1]) for one in properties])
                table = np.frombuffer(body, dtype, count, at)
                at += dtype.itemsize * count
                found = {
                    key: table[key].astype(table[key].dtype.newbyteorder("="))
                    for key in dtype.names or ()
                }
        except ValueError as why:
            raise ValueError(f"{path}: element {name}: {why}") from None
        yield name, found, count if lists else 0


def _text_columns(rows: list[list[str]], properties: list[list[str]]) -> dict[str, Array]:
    """Returns the columns of a table."""
    for k, row in enumerate(rows):
        if len(row) < len(properties):
            raise ValueError(f"row {k} has {len(row)} of {len(properties)} numbers")
    return {
        one[0]: np.array([row[k] for row in rows], float if one[1][0] == "f" else np.int64)
        for k, one in enumerate(properties)
    }


def read_meshio(path: Path) -> Scene:
    """Reads the edges (beams, trusses) of a mesh by ``meshio``."""
    meshio = library("meshio", "mesh")
    scene = Scene(place=str(path))
    if path.suffix.lower() == ".inp":
        _check_abaqus(path)
    elif path.suffix.lower() in (".bdf", ".nas", ".fem"):
        _check_nastran(path, scene)
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed):
            mesh = meshio.read(path)
    except ImportError:
        raise
    except (Exception, SystemExit) as why:  # meshio raises many kinds, and prints why it exits
        exits = isinstance(why, SystemExit)
        said = printed.getvalue() if exits else f"{type(why).__name__}: {why}"
        said = " ".join(said.split())
        raise ValueError(f"{path}: meshio cannot read this mesh: {said}") from why
    points = np.asarray(mesh.points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{path}: points of the shape {points.shape}, expected 3 dimensions")
    shapes = {name: np.shape(values) for name, values in mesh.point_data.items()}
    _note_vectors(scene, (name for name, shape in shapes.items() if shape == points.shape))
    lines: list[Array] = []
    for block in mesh.cells:
        if block.type == "line":
            lines += list(np.asarray(block.data, np.int64))
        elif block.type.startswith(("line", "VTK_LAGRANGE_CURVE", "VTK_BEZIER_CURVE")):
            scene.left_out.add("curved line(s)", block.type, len(block.data))
    return _lines(scene, points, lines)


# Keywords of Abaqus that make, move, copy or include nodes or elements, which meshio ignores.
ABAQUS = {*"INSTANCE SYSTEM NGEN NCOPY NFILL NMAP ELGEN ELCOPY INCLUDE SUBSTRUCTURE".split()}


def _check_abaqus(path: Path) -> None:
    """Raises an error if a file has nodes or elements that meshio reads wrong."""
    blocks = 0
    for number, line in enumerate(path.read_text(encoding="latin-1").splitlines(), 1):
        if not line.startswith("*") or line.startswith("**"):
            continue
        keyword, *rest = line[1:].upper().replace(" ", "").split(",")
        blocks += keyword == "NODE"
        elsewhere = keyword in ("NODE", "ELEMENT") and any(
            one.startswith(("INPUT=", "SYSTEM=")) and one != "SYSTEM=R" for one in rest
        )
        if keyword in ABAQUS or elsewhere or keyword == "NODE" and blocks > 1:
            raise ValueError(
                f"{path}, line {number}: {line.strip()} is not read: write a flat file, with one "
                "*NODE of global coordinates and no parts"
            )


# Elements of Nastran with two ends or more that meshio does not read as lines, and those that it
# reads if the name is in capitals and in the small format.
NASTRAN = {
    *"CBEAM3 CBEND CDAMP1 CDAMP2 CDAMP3 CDAMP4 CELAS1 CELAS2 CELAS3 CELAS4 CFAST".split(),
    *"CONROD CTUBE CVISC CWELD PLOTEL RBAR RROD".split(),
}
NASTRAN_LINES = {*"CBAR CBEAM CBUSH CBUSH1D CGAP CROD".split()}


def _check_nastran(path: Path, scene: Scene) -> None:
    """Raises an error if a file has points that meshio reads wrong, and counts elements that it
    does not read."""
    lines = iter(path.read_text(encoding="latin-1").splitlines())
    before = list(takewhile(lambda line: not line.strip().startswith("BEGIN BULK"), lines))
    cards = [line for line in lines if len(line) > 2 and not line.startswith(("$", "//", "#"))]
    if not cards:
        raise ValueError(f"{path}: no cards after BEGIN BULK: add it before the first GRID")
    for card in [*before, *takewhile(lambda line: not line.startswith("ENDDATA"), cards)]:
        width = 16 if "*" in card[:8] else 8
        fields = card.split(",") if "," in card else [card[:8], "", card[8 + width :][:width]]
        word, system = fields[0].strip(), "".join(fields[2:3]).strip()
        name = word.upper().rstrip("* ")
        if name.startswith("INCLUDE") or name in ("GRID", "GRDSET") and system not in ("", "0"):
            raise ValueError(
                f"{path}: {card.strip()} is not read: write one file, with GRID in the basic "
                "coordinate system"
            )
        if name in NASTRAN or name in NASTRAN_LINES and name != word:
            scene.left_out.add(f"element(s) {word}", card.strip())


def read_files(parse: Callable[[Path], Scene]) -> Callable[[Sequence[Path], Options], Frames]:
    """Returns a reader of files that have one frame each."""

    def read(paths: Sequence[Path], options: Options) -> Frames:
        return frames_of_files(paths, parse, options)

    return read
