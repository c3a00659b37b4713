"""Files of other programs, each with the same two linked rings."""

import base64
import bz2
import gzip
import importlib.util
import json
import lzma
import os
import pathlib
import pickle
import re
import signal
import struct
import subprocess
import zlib

import linkwatch
import numpy as np
import pytest
from conftest import COMMAND, PATIENCE, until
from linkwatch import io
from linkwatch._command import main
from test_command import run

# Rings of 12 points; one is in the plane z = 0, the other one in y = 0.
ANGLE = 2 * np.pi * np.arange(12) / 12
RING = np.stack([np.cos(ANGLE), np.sin(ANGLE), 0 * ANGLE], axis=1)
OTHER = np.stack([1 + np.cos(ANGLE), 0.02 + 0 * ANGLE, np.sin(ANGLE)], axis=1)
POINTS = np.concatenate([RING, OTHER])
# Edges of the rings, and lists of points that return.
EDGES = [(12 * k + i, 12 * k + (i + 1) % 12) for k in range(2) for i in range(12)]
LOOPS = [[*range(12 * k, 12 * k + 12), 12 * k] for k in range(2)]


def needs(*modules):
    """Skips a test if one of these libraries is not installed."""
    for module in modules:
        found = importlib.util.find_spec(module.split(".")[0])
        if found is None:
            pytest.skip(f"{module} is not installed")


def rows(points, end=""):
    """Returns points as lines of text."""
    return "".join(f"{x:.7g} {y:.7g} {z:.7g}{end}\n" for x, y, z in points)


PACKERS = {"ZLib": zlib.compress, "LZMA": lzma.compress}


def vtk(version="3.0", lines=LOOPS):
    if version == "5.1":
        ends = np.cumsum([0, *map(len, lines)])
        flat = " ".join(str(i) for line in lines for i in line)
        section = (
            f"LINES {len(ends)} {ends[-1]}\nOFFSETS vtktypeint64\n{' '.join(map(str, ends))}\n"
            f"CONNECTIVITY vtktypeint64\n{flat}\n"
        )
    else:
        size = sum(map(len, lines)) + len(lines)
        section = f"LINES {len(lines)} {size}\n" + "".join(
            " ".join(map(str, [len(line), *line])) + "\n" for line in lines
        )
    return (
        f"# vtk DataFile Version {version}\ncoils\nASCII\nDATASET POLYDATA\n"
        "FIELD FieldData 1\nTIME 1 1 double\n0.25\n"
        f"POINTS 24 float\n{rows(POINTS)}\nMETADATA\nINFORMATION 0\n\n{section}"
        "POINT_DATA 24\nSCALARS s float\n"
    )


def vtk_binary():
    lines = np.array([[13, *loop] for loop in LOOPS], ">i4")
    return (
        b"# vtk DataFile Version 3.0\ncoils\nBINARY\nDATASET POLYDATA\nPOINTS 24 float\n"
        + POINTS.astype(">f4").tobytes()
        + b"\nLINES 2 28\n"
        + lines.tobytes()
        + b"\n"
    )


def vtk_grid():
    cells = "".join(f"2 {a} {b}\n" for a, b in EDGES)
    return (
        "# vtk DataFile Version 2.0\nbeams\nASCII\nDATASET UNSTRUCTURED_GRID\n"
        f"POINTS 24 double\n{rows(POINTS)}CELLS 26 80\n{cells}3 0 1 2\n3 0 2 3\n"
        f"CELL_TYPES 26\n{'3 ' * 24}5 21\n"
    )


def vtp(form="ascii", compressed="", header="<u4", lines=LOOPS):
    """Returns a .vtp file, with arrays in each way that VTK writes them."""
    appended = b""

    def packed(values):
        raw = values.tobytes()
        if not compressed:
            return np.array(len(raw), header).tobytes() + raw, b""
        blocks = [raw[i : i + 64] for i in range(0, len(raw), 64)]
        small = [PACKERS[compressed](block) for block in blocks]
        sizes = [len(blocks), 64, len(raw) % 64, *map(len, small)]
        return np.array(sizes, header).tobytes(), b"".join(small)

    def array(name, values, kind, components=1):
        nonlocal appended
        head, data = packed(values)
        text, offset = "", ""
        if form == "ascii":
            text = " ".join(f"{v:.9g}" if kind[0] == "F" else str(v) for v in values.ravel())
        elif form == "binary":
            text = "".join(base64.b64encode(part).decode() for part in (head, data))
        else:
            offset = f' offset="{len(appended)}"'
            appended += head + data
        shape = f'NumberOfComponents="{components}"'
        how = form.split("-")[0]
        kind_ = f'type="{kind}" Name="{name}" {shape} format="{how}"{offset}'
        return f"<DataArray {kind_}>{text}</DataArray>"

    flat = np.array([i for line in lines for i in line], "<i8")
    ends = np.cumsum([len(line) for line in lines]).astype("<i8")
    body = (
        f"<Points>{array('Points', POINTS.astype('<f8'), 'Float64', 3)}</Points>"
        f"<Lines>{array('connectivity', flat, 'Int64')}{array('offsets', ends, 'Int64')}</Lines>"
    )
    kind = f'header_type="UInt{8 * int(header[-1])}"'
    packer = f' compressor="vtk{compressed}DataCompressor"' if compressed else ""
    tail = b"</VTKFile>\n"
    if appended:
        tail = b'<AppendedData encoding="raw">\n_' + appended + b"\n</AppendedData>" + tail
    head = (
        f'<?xml version="1.0"?><VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" '
        f'{kind}{packer}><PolyData><FieldData><DataArray type="Float64" Name="TimeValue" '
        f'NumberOfTuples="1" format="ascii">0.25</DataArray></FieldData>'
        f'<Piece NumberOfPoints="24" NumberOfLines="2">{body}</Piece></PolyData>'
    )
    return head.encode() + tail


def ply(form="ascii"):
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[form]
    header = (
        f"ply\nformat {form} 1.0\ncomment blender\nelement vertex 24\nproperty float x\n"
        "property float y\nproperty float z\nelement face 1\n"
        "property list uchar int vertex_indices\nelement edge 24\nproperty int vertex1\n"
        "property int vertex2\nend_header\n"
    ).encode()
    if not order:
        edges = "".join(f"{a} {b}\n" for a, b in EDGES)
        return header + (rows(POINTS) + "3 0 1 2\n" + edges).encode()
    face = struct.pack(order + "B3i", 3, 0, 1, 2)
    return (
        header
        + POINTS.astype(order + "f4").tobytes()
        + face
        + np.array(EDGES, order + "i4").tobytes()
    )


def coils():
    text = "periods 2\nbegin filament\nmirror NIL\n"
    for ring, name in ((RING, "upper"), (OTHER, "lower")):
        text += rows(ring, " 100.0")
        x, y, z = ring[0]
        text += f"{x:.7g} {y:.7g} {z:.7g} 0.0 1 {name}\n"
    return text + "end\n"


def poly(first=1):
    points = "".join(
        f"{first + k}: {row}" for k, row in enumerate(rows(POINTS, " 1").splitlines(1))
    )
    loops = "".join(
        f"{k + 1}: {' '.join(str(first + i) for i in loop[:-1])} <\n"
        for k, loop in enumerate(LOOPS)
    )
    return f"POINTS\n{points}POLYS\n{loops}END\n"


def hair():
    header = struct.pack("<4s4If f3f88s", b"HAIR", 2, 26, 7, 0, 0.5, 0, 1, 1, 1, b"test")
    loops = POINTS[np.concatenate(LOOPS)].astype("<f4")
    widths = np.linspace(0.1, 0.2, 26, dtype="<f4")
    return header + np.array([12, 12], "<u2").tobytes() + loops.tobytes() + widths.tobytes()


def usc():
    loops = [POINTS[loop].astype("<f4") for loop in LOOPS]
    strands = b"".join(struct.pack("<i", len(loop)) + loop.tobytes() for loop in loops)
    return struct.pack("<i", 3) + strands + struct.pack("<i3f", 1, 0, 0, 0)


def tg3(kind="Linear", repeats=(), rings=(RING, OTHER), periodic=1):
    yarns = ""
    for k, ring in enumerate(rings):
        nodes = "".join(
            f'<MasterNode index="{i}" Position="{x:.9g}, {y:.9g}, {z:.9g}" Tangent="0, 0, 0"/>'
            for i, (x, y, z) in enumerate([*ring, ring[0]] if not repeats else ring)
        )
        vectors = "".join(f'<Repeat value="{x}, {y}, {z}"/>' for x, y, z in repeats)
        how = f'<Interpolation Periodic="{periodic}" type="CInterpolation{kind}"/>'
        yarns += f'<Yarn index="{k}">{how}{vectors}{nodes}</Yarn>'
    return (
        f'<?xml version="1.0"?><TexGenModel version="3.5"><Textile>{yarns}</Textile></TexGenModel>'
    )


# Files by name, and texts that their summaries must contain besides "2 curves, 2 closed".
FILES = {
    "a.vtk": (vtk(), []),
    "new.vtk": (vtk("5.1"), []),
    "binary.vtk": (vtk_binary(), []),
    "grid.vtk": (vtk_grid(), ["edges that share a point are joined", "not read, so not verified"]),
    "a.vtp": (vtp(), []),
    "binary.vtp": (vtp("binary"), []),
    "zlib.vtp": (vtp("binary", "ZLib"), []),
    "appended.vtp": (vtp("appended", "", "<u8"), []),
    "appended-lzma.vtp": (vtp("appended", "LZMA"), []),
    "edges.vtp": (vtp(lines=EDGES), ["edges that share a point are joined"]),
    "a.ply": (ply(), ["edges that share a point are joined"]),
    "little.ply": (ply("binary_little_endian"), []),
    "big.ply": (ply("binary_big_endian"), []),
    "coils.test": (coils(), ["2 curves are closed, because the last point repeats the first one"]),
    "a.coils": (coils().replace(" 100.0", " 1.0D+02").replace("mirror NIL", "FOCUS"), []),
    "a.poly": (poly(), []),
    "from-0.poly": (poly(0), []),
    "a.hair": (hair(), ["2 curves are closed, because"]),
    "usc.data": (usc(), ["1 strands of one point are no curves"]),
    "a.tg3": (tg3(), ["2 curves are closed, because"]),
}


def written(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("name", FILES)
def test_two_linked_rings_are_linked(tmp_path, name):
    content, words = FILES[name]
    path = written(tmp_path, name, content)
    frames = linkwatch.read(path)
    (frame,) = frames
    assert (frame.counts, frame.basis) == ([-12, -12], "polyline")
    np.testing.assert_allclose(np.sort(frame.positions, axis=0), np.sort(POINTS, axis=0), atol=1e-6)
    assert linkwatch.certify(frame.positions, frame.counts).links == [(0, 1, -1)]
    for word in ["2 curves, 2 closed", *words]:
        assert word in str(frames.summary)
    # The command does the same, and its archive keeps what was left out.
    out = tmp_path / "out.npz"
    code, _, err = run("convert", path, out)
    assert code == (3 if frames.summary.left_out else 0), err
    assert "2 curves, 2 closed" in err
    code, said, err = run("certify", out)
    assert (code == 3) == bool(frames.summary.left_out), err
    assert said == "2 # lines: 1\n0,1,-1\n"


def obj(spline):
    """Returns two linked rings: lines, and a spline through the points of the other ring."""
    numbers = [" ".join(str(k + 1) for k in loop) for loop in LOOPS]
    vertices = "".join(f"v {row}\n" for row in rows(POINTS).splitlines())
    return f"{vertices}l {numbers[0]}\ncstype {spline.format(numbers[1])}end\n"


@pytest.mark.parametrize(
    "spline",
    [
        "bspline\ndeg 2\ncurv 0 12 {} \\\n14\nparm u " + " ".join(map(str, range(-2, 15))) + "\n",
        "bspline\ndeg 3\ncurv 3 15 {} 14 15\nparm u " + " ".join(map(str, range(19))) + "\n",
        "rat bezier\ndeg 3\ncurv 0 4 {}\n",
        "bezier\ndeg 2\ncurv 0 6 {}\nparm u 0 1 2 3 4 5 6\n",
    ],
)
def test_free_form_curves_of_an_obj_become_bezier_pieces(tmp_path, spline):
    path = written(tmp_path, "a.obj", obj(spline))
    (frame,) = frames = linkwatch.read(path, format="obj")
    assert (frame.basis, len(frame.counts), frames.summary.left_out) == ("bezier", 2, [])
    assert all(count < 0 for count in frame.counts), frames.summary
    assert linkwatch.certify(frame.positions, frame.counts, basis="bezier").links == [(0, 1, -1)]
    # The command names this reader.
    code, _, err = run("certify", path)
    assert code == 3 and "--format obj" in err


@pytest.mark.parametrize(
    ("spline", "why"),
    [
        ("bspline\ndeg 4\ncurv 0 1 {}\n", "degree '4'"),
        ("cardinal\ndeg 3\ncurv 0 1 {}\n", "of the cstype 'cardinal'"),
        ("bspline\ndeg 3\ncurv 0 1 {}\nparm u 0 0 0 1 1 1\n", "with 6 knots, expected 17"),
        ("bezier\ndeg 3\ncurv 0 1 {} 14\n", "with 14 points"),
    ],
)
def test_free_form_curves_that_are_not_read_are_counted(tmp_path, spline, why):
    frames = linkwatch.read(written(tmp_path, "a.obj", obj(spline)), format="obj")
    assert len(list(frames)[0].counts) == 1
    assert len(frames.summary.left_out) == 1 and why in frames.summary.left_out[0]


def test_names_radii_and_times_are_read(tmp_path):
    (frame,) = linkwatch.read(written(tmp_path, "coils.w7x", coils()))
    assert frame.names == ["1 upper", "1 lower"]
    (frame,) = linkwatch.read(written(tmp_path, "a.hair", hair()))
    assert frame.radii == pytest.approx([0.5 * (0.1 + 12 * 0.004), 0.1])
    for name, content in (("a.vtk", vtk()), ("a.vtp", vtp())):
        (frame,) = linkwatch.read(written(tmp_path, name, content))
        assert frame.time == 0.25
    assert frame.positions.dtype == np.float64
    (frame,) = linkwatch.read(written(tmp_path, "binary.vtk", vtk_binary()))
    assert frame.positions.dtype == np.float32


def test_several_files_are_frames(tmp_path):
    for k in (10, 9, 11):
        moved = POINTS + np.repeat([[0, 0, 0], [2.5 * (k > 10), 0, 0]], 12, axis=0)
        written(tmp_path, f"f{k}.ply", ply().replace(rows(POINTS).encode(), rows(moved).encode()))
    frames = linkwatch.read(*tmp_path.glob("*.ply"))
    assert [frame.seq for frame in frames] == [0, 1, 2]
    assert len(frames) == 3
    links = [len(linkwatch.certify(f.positions, f.counts).links) for f in frames]
    assert links == [1, 1, 0]
    out = tmp_path / "out.npz"
    code, _, err = run("convert", *tmp_path.glob("*.ply"), out)
    assert code == 0, err
    code, said, _ = run("check", out)
    assert (code, "curves 0 and 1 came apart" in said) == (1, True)
    with pytest.raises(ValueError, match="different formats"):
        linkwatch.read(tmp_path / "f9.ply", written(tmp_path, "a.vtk", vtk()))


def test_the_command_reads_files_of_the_package(tmp_path):
    files = []
    for k in range(3):
        moved = POINTS + np.repeat([[0, 0, 0], [2.5 * (k > 1), 0, 0]], 12, axis=0)
        changed = ply().replace(rows(POINTS).encode(), rows(moved).encode())
        files.append(written(tmp_path, f"f{k}.ply", changed))
    code, said, err = run("check", *files, "--events=off")
    assert (code, "curves 0 and 1 came apart" in said) == (1, True), err
    assert run("check", *files[:2])[0] == 0
    assert run("certify", files[0])[:2] == (0, "2 # lines: 1\n0,1,-1\n")
    assert run("certify", "--cell", "9,9,9", files[0])[0] == 0
    code, said, err = run("measure", "writhe", files[0])
    assert code == 0 and "writhe" in said, err


def test_results_of_the_command_name_the_files_that_the_package_reads(tmp_path):
    # Regression test: they had the name of a temporary archive.
    moved = ply().replace(rows(POINTS).encode(), rows(POINTS + [0.1, 0, 0]).encode())
    files = [written(tmp_path, f"{k}.ply", content) for k, content in enumerate((ply(), moved))]
    code, out, err = run("check", "--json", *files, "--junit", tmp_path / "junit.xml")
    lines = [json.loads(line) for line in out.splitlines()]
    assert [line["model"] for line in lines if "report" in line] == [*map(str, files)], err
    text = (tmp_path / "junit.xml").read_text()
    assert code == 0 and "linkwatch-" not in text and str(files[1]) in text, text


def test_a_frame_at_no_time_is_replayed(tmp_path):
    # Regression test: its verdicts differed, because NaN is unlike itself.
    assert "\n0.25\n" in vtk()
    times = ["0", "nan", "2"]
    contents = [vtk().replace("\n0.25\n", f"\n{time}\n") for time in times]
    files = [written(tmp_path, f"{k}.vtk", content) for k, content in enumerate(contents)]
    recording = tmp_path / "a.mcap"
    assert run("check", *files, "--record", recording)[0] == 0
    code, out, err = run("replay", recording)
    assert code == 0, (out, err)


def apart(content):
    """Returns a file of two linked rings, with the second one elsewhere."""
    moved = POINTS + np.repeat([[0, 0, 0], [9, 0, 0]], 12, axis=0)
    text = content if isinstance(content, bytes) else content.encode()
    assert rows(POINTS).encode() in text
    return text.replace(rows(POINTS).encode(), rows(moved).encode())


def test_files_of_several_formats_are_frames_of_one_motion(tmp_path):
    # Regression test: files of one frame each were taken for a run of its own, which was intact.
    contents = {"1.vtk": vtk(), "2.vtk": vtk(), "3.ply": apart(ply()), "4.ply": apart(ply())}
    files = [written(tmp_path, name, content) for name, content in contents.items()]
    code, out, err = run("check", *files, "--events=off")
    assert code == 1 and f"{files[2]}: changed" in out, (out, err)


def test_compressed_files_keep_their_order(tmp_path):
    # Regression test: compressed files came first.
    first = written(tmp_path, "1.ply", ply())
    second = written(tmp_path, "2.ply.gz", gzip.compress(apart(ply())))
    code, out, err = run("check", first, second, "--events=off")
    assert code == 1 and "was -1, is 0" in out, (out, err)


def test_compressed_files_are_named_as_they_were_given(tmp_path):
    # Regression test: results and errors named a temporary file, another one in each run.
    first, second, third = (tmp_path / f"{name}.gz" for name in ("1.ply", "2.ply", "3.npz"))
    first.write_bytes(gzip.compress(ply()))
    second.write_bytes(gzip.compress(apart(ply())))
    assert run("convert", second, tmp_path / "3.npz")[0] == 0
    third.write_bytes(gzip.compress((tmp_path / "3.npz").read_bytes()))
    record = tmp_path / "run.mcap"
    options = ("--events=off", "--json", "--record", record, "--force")
    code, out, err = run("check", first, second, third, *options)
    models = [json.loads(line).get("model") for line in out.splitlines()]
    frames = [f"{file}, frame 0" if file == third else str(file) for file in (first, second, third)]
    assert (code, models[:3]) == (1, frames), (out, err)
    assert "linkwatch-" not in out + err
    packed = tmp_path / "run.mcap.gz"
    packed.write_bytes(gzip.compress(record.read_bytes()))
    code, out, err = run("replay", packed)
    assert code == 1 and "linkwatch-" not in out + err, (out, err)
    code, out, err = run("check", packed, "--events=off")
    assert code == 1 and f"{packed}, frame 1: changed" in out, (out, err)
    for file, content in ((first, ply()[:-20]), (third, b"PK")):
        file.write_bytes(gzip.compress(content))
        code, out, err = run("certify", file)
        assert code == 2 and err.splitlines()[-1].startswith(f"error: {file}: "), err
        assert "linkwatch-" not in err


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_killed_command_leaves_no_unpacked_files(tmp_path, number):
    # Regression test: they stayed in the temporary folder.
    packed, pipe, folder = (tmp_path / name for name in ("a.ply.gz", "pipe", "temporary"))
    packed.write_bytes(gzip.compress(ply()))
    os.mkfifo(pipe)
    folder.mkdir()
    words = [COMMAND, "certify", packed, "-o", pipe]
    environment = {**os.environ, "TMPDIR": str(folder)}
    # It waits for a reader of the pipe.
    with subprocess.Popen([*map(str, words)], env=environment) as waiting:
        until("the unpacked file", lambda: list(folder.glob("linkwatch-*/**/a.ply")))
        waiting.send_signal(number)
        assert waiting.wait(PATIENCE) == -number
    until("its end", lambda: not list(folder.glob("linkwatch-*")))


def test_a_folder_skips_no_file_of_the_package_in_silence(tmp_path):
    # Regression test: the compressed file was skipped, and the others were intact.
    files = [written(tmp_path, f"{k}.vtk", vtk()) for k in (1, 2)]
    packed = written(tmp_path, "3.vtk.gz", gzip.compress(apart(vtk())))
    code, out, err = run("check", tmp_path)
    assert (code, out) == (2, "") and "3.vtk.gz is compressed" in err
    packed.unlink()
    # Hidden files are of other programs.
    written(tmp_path, ".1.npz", "")
    assert run("check", tmp_path)[0] == 0
    for file in files:
        file.unlink()
    for k, content in enumerate((ply(), apart(ply()))):
        written(tmp_path, f"{k}.ply", content)
    assert run("check", tmp_path, "--events=off")[0] == 1


def test_a_run_is_verified_again_if_its_topology_changed(tmp_path):
    # Regression test: `--resume` skipped it.
    path = written(tmp_path, "a.dat", "")
    lines = tmp_path / "out.jsonl"
    for k in range(2):
        (tmp_path / "a.top").write_text("1" * (k + 1))
        code, out, err = run("check", "--each", path, "-o", lines, *["--resume"] * k)
        assert "1 verified now" in err, err


def test_a_folder_of_files_of_the_package_is_read(tmp_path):
    folder = tmp_path / "frames"
    folder.mkdir()
    files = [written(folder, f"{k}.vtk", vtk()) for k in (9, 10)]
    written(folder, "notes.inp", "")
    code, out, err = run("check", folder)
    assert code == 0, err
    assert out.startswith("".join(f"{file}: intact\n" for file in files)), out


def test_frames_before_a_damaged_file_have_their_verdicts(tmp_path):
    # Regression test: there was no verdict at all.
    moved = POINTS + np.repeat([[0, 0, 0], [2.5, 0, 0]], 12, axis=0)
    apart = ply().replace(rows(POINTS).encode(), rows(moved).encode())
    contents = (ply(), apart, ply()[:-20])
    files = [written(tmp_path, f"{k}.ply", content) for k, content in enumerate(contents)]
    code, out, err = run("check", *files, "--events=off")
    assert code == 2 and f"{files[1]}: changed" in out, (out, err)
    assert err.splitlines()[-1].startswith(f"error: {files[2]}: ")


def test_compressed_certificates_are_baselines(tmp_path):
    path = written(tmp_path, "a.ply", ply())
    certificate = tmp_path / "certificate.txt"
    assert run("certify", path, "-o", certificate)[0] == 0
    packed = written(tmp_path, "certificate.txt.gz", gzip.compress(certificate.read_bytes()))
    code, out, err = run("check", path, "--baseline", packed)
    assert code == 0 and ": intact" in out, (code, out, err)


def test_files_of_the_package_have_the_general_options(tmp_path):
    """Regression test: general options raised errors for these files."""
    paths = [written(tmp_path, f"-{k}.ply", ply()) for k in range(2)]
    for words in (["--json", "check"], ["check", "--json"], ["-q", "--threads", "1", "check"]):
        code, out, err = run(*words, *paths)
        assert code == 0 and ('{"' in out) == ("--json" in words), (words, out, err)
        assert ("2 curves" in err) == ("-q" not in words)
    archive = tmp_path / "out.npz"
    code, out, err = run("convert", "--json", *paths, archive)
    assert code == 0 and json.loads(out)["frames"] == 2, err
    code, out, err = run("-q", "convert", *paths, archive, "--force", "--keep-order", "-v")
    assert (code, err) == (0, "") and len(linkwatch.read(archive)) == 2, out
    code, out, err = run("convert", *paths, archive, "--frame", "1", "--force")
    assert code == 0 and len(linkwatch.read(archive)) == 1, err
    code, out, err = run("convert", *paths, archive, "--frame=2", "--force")
    assert code == 2 and "no frame 2" in err, err
    # Regression test: the abbreviated option was ignored, and all frames were written.
    code, out, err = run("convert", *paths, archive, "--fram", "1", "--force")
    assert code == 2 and "--fram" in err, (code, err)
    words = [str(COMMAND), "check", "--", *(path.name for path in paths)]
    assert subprocess.run(words, cwd=tmp_path, timeout=PATIENCE).returncode == 0
    code, out, err = run("--json", "measure", "writhe", paths[0])
    assert code == 0 and '"writhe"' in out, (out, err)
    code, out, err = run("check", "--each", "--select", "name C", *paths)
    assert code == 2 and "`select` is no option for files of the format ply" in out, (out, err)


def test_each_file_of_the_package_is_a_run_of_its_own(tmp_path):
    for name, shift in (("a", 0), ("b", 2.5)):
        moved = POINTS + np.repeat([[0, 0, 0], [shift, 0, 0]], 12, axis=0)
        frames = [io.Frame(p, [-12, -12], seq=k) for k, p in enumerate((POINTS, moved))]
        (path,) = linkwatch.write(frames, tmp_path / f"{name}.npz")
        (tmp_path / f"{name}.npz.gz").write_bytes(gzip.compress(path.read_bytes()))
    packed = [tmp_path / f"{name}.npz.gz" for name in "ab"]
    code, said, err = run("check", "--each", *packed)
    lines = map(json.loads, said.splitlines())
    assert {line["file"]: line["verdict"] for line in lines} == {
        str(packed[0]): "intact",
        str(packed[1]): "changed",
    }
    assert code == 1, err
    assert run("convert", packed[0], tmp_path / "again.npz")[0] == 0


def test_the_command_reads_its_own_files_without_the_readers():
    suffixes = " ".join(one.suffixes for one in io.FORMATS).split()
    assert not set(suffixes) & set(io.OWN)


def test_a_collection_of_paraview_has_times(tmp_path):
    for name in ("a.vtp", "b.vtp"):
        written(tmp_path, name, vtp())
    sets = '<DataSet timestep="2.5" file="b.vtp"/><DataSet timestep="0.5" file="a.vtp"/>'
    text = f'<VTKFile type="Collection"><Collection>{sets}</Collection></VTKFile>'
    frames = linkwatch.read(written(tmp_path, "run.pvd", text))
    assert [frame.time for frame in frames] == [0.5, 2.5]
    # Regression test: a compressed collection did not find its files.
    packed = tmp_path / "packed.pvd.gz"
    packed.write_bytes(gzip.compress(text.encode()))
    assert [frame.time for frame in linkwatch.read(packed)] == [0.5, 2.5]


def test_parts_and_blocks_of_paraview_are_read_together(tmp_path):
    for name in ("a.vtp", "b.vtp"):
        written(tmp_path, name, vtp())
    kinds = {"a.pvtp": "PPolyData", "a.vtm": "vtkMultiBlockDataSet"}
    parts = '<PPolyData><Piece Source="a.vtp"/><Piece Source="b.vtp"/></PPolyData>'
    blocks = '<vtkMultiBlockDataSet><Block><DataSet file="a.pvtp"/></Block></vtkMultiBlockDataSet>'
    for name, inside in (("a.pvtp", parts), ("a.vtm", blocks)):
        text = f'<VTKFile type="{kinds[name]}">{inside}</VTKFile>'
        frames = linkwatch.read(written(tmp_path, name, text))
        assert [frame.counts for frame in frames] == [[-12] * 4]
    assert "cut there" in str(linkwatch.read(tmp_path / "a.pvtp").summary)
    # Regression test: a file that includes itself raised a RecursionError.
    around = parts.replace("b.vtp", "a.vtm")
    written(tmp_path, "a.pvtp", f'<VTKFile type="PPolyData">{around}</VTKFile>')
    for name in ("a.pvtp", "a.vtm"):
        with pytest.raises(ValueError, match="the file names itself, or a file that names it"):
            linkwatch.read(tmp_path / name)


@pytest.mark.parametrize("suffix", ["gz", "bz2", "xz"])
def test_compressed_files_are_unpacked(tmp_path, suffix):
    opened = {"gz": gzip.open, "bz2": bz2.open, "xz": lzma.open}[suffix]
    for name, content in (("a.vtk", vtk()), ("a.obj", TEXT["a.obj"])):
        path = tmp_path / f"{name}.{suffix}"
        with opened(path, "wb") as file:
            file.write(content.encode())
        frames = linkwatch.read(path)
        for _ in range(2):
            (frame,) = frames
            assert frame.counts == [-12, -12]
        folder = frames.path.parent
        again = pickle.loads(pickle.dumps(frames))
        assert [frame.counts for frame in again] == [[-12, -12]]
        del frames, frame
        assert not (folder / name).exists()
    # Regression test: two files of the same name in different folders were an error.
    (tmp_path / "b").mkdir()
    other = tmp_path / "b" / path.name
    other.write_bytes(path.read_bytes())
    assert len(linkwatch.read(path, other, path)) == 3
    code, out, err = run("check", path, other)
    assert code == 0 and "2 frames verified" in out, (out, err)
    # Regression test: a file was written outside the temporary folder.
    folder = tmp_path / "folder"
    around = tmp_path.joinpath(*[".."] * 30, *tmp_path.parts[1:], path.name)
    (found,) = io.unpacked([around], folder)
    assert folder.resolve() in found.resolve().parents
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(ValueError, match=f"a.obj.{suffix}: "):
        linkwatch.read(path)


def test_a_closed_curve_that_was_cut_is_an_invalid_frame(tmp_path):
    written(tmp_path, "coils.1", coils())
    x, y, z = RING[0]
    cut = coils().replace(f"{x:.7g} {y:.7g} {z:.7g} 0.0 1 upper", "0.8 0 0 0.0 1 upper")
    written(tmp_path, "coils.2", cut)
    frames = list(linkwatch.read(tmp_path / "coils.1", tmp_path / "coils.2"))
    assert frames[0].rejected is None
    assert "the ends of curve 0, which is closed, are apart" in frames[1].rejected


def test_only_the_suffix_or_the_contents_of_coils_tell_the_format(tmp_path):
    """Regression test: every name that begins with `coils.` was read as a MAKEGRID file."""
    path = written(tmp_path, "coils.inp", coils())
    assert linkwatch.read(path).summary.curves == 2
    for name, content in (("coils.obj", TEXT["a.obj"]), ("coils.vtk", vtk())):
        assert linkwatch.read(written(tmp_path, name, content)).summary.curves == 2
    assert run("convert", path, tmp_path / "coils.npz")[0] == 0
    assert linkwatch.read(tmp_path / "coils.npz").summary.curves == 2
    # Values of options are no coils.
    certificate = written(tmp_path, "coils.cert", "")
    for more in (["--force", "-o", certificate], ["--force", f"-o{certificate}"]):
        code, out, err = run("certify", path, *more)
        assert code == 0 and certificate.read_text() == "2 # lines: 1\n0,1,-1\n", (out, err)
    for file in (path, tmp_path / "coils.npz"):
        code, out, err = run("check", "--baseline", certificate, file)
        assert code == 0 and ": intact" in out, (out, err)


def test_open_curves_are_closed_only_on_request(tmp_path):
    path = written(tmp_path, "a.vtk", vtk(lines=[loop[:-1] for loop in LOOPS]))
    assert next(iter(linkwatch.read(path))).counts == [12, 12]
    frames = linkwatch.read(path, closed=True)
    assert "2 curves are closed by a segment" in str(frames.summary)
    (frame,) = frames
    assert linkwatch.certify(frame.positions, frame.counts).links == [(0, 1, -1)]
    path = written(tmp_path, "coils.a", coils())
    assert next(iter(linkwatch.read(path, closed=False))).counts == [13, 13]
    out = tmp_path / "out.npz"
    assert run("convert", "--closed", written(tmp_path, "b.vtk", vtk()), out)[0] == 0


def test_curves_that_are_not_read_are_counted(tmp_path):
    star = [*EDGES, (0, 12)]
    with pytest.raises(ValueError, match="no curves: not read: 1 set of edges with branches"):
        linkwatch.read(written(tmp_path, "a.vtp", vtp(lines=star)))
    frames = linkwatch.read(written(tmp_path, "grid.vtk", vtk_grid()))
    assert frames.summary.left_out == ["1 quadratic edge (cell 25)"]
    lists = "element strand 1\nproperty list uchar int vertex_indices\nend_header"
    content = ply().replace(b"end_header", lists.encode()) + b"2 0 1\n"
    frames = linkwatch.read(written(tmp_path, "a.ply", content))
    assert frames.summary.left_out == ["1 element with lists of points (strand) (strand 0)"]


def test_lines_that_share_an_end_are_joined(tmp_path):
    """Regression test: `vtkStripper` splits long rings, and the parts were read as open curves."""
    lines = []
    for k in range(2):
        lines += [(*range(12 * k, 12 * k + 7),), (12 * k, *range(12 * k + 11, 12 * k + 6, -1))]
        lines.append((12 * k + 7, 12 * k + 6))
    frames = linkwatch.read(written(tmp_path, "a.vtk", vtk(lines=lines)))
    assert [frame.counts for frame in frames] == [[-12, -12]]
    assert "lines that share an end are joined" in str(frames.summary)
    (frame,) = frames
    np.testing.assert_allclose(frame.positions, POINTS, atol=1e-6)
    # Three ends that meet do not tell what continues what, nor does a line that is there twice.
    for lines, counts in (
        ([(0, 1, 2), (2, 3, 4), (2, 5, 6)], [3, 3, 3]),
        ([(0, 1, 2), (0, 1, 2)], [3, 3]),
        ([(0, 1, 2, 3), (3, 1)], [4, 2]),
    ):
        (frame,) = linkwatch.read(written(tmp_path, "b.vtk", vtk(lines=lines)))
        assert frame.counts == counts
    # An edge of a set with branches stays in it.
    edges = [(0, 1, 2), (2, 3), (3, 4), (3, 5)]
    frames = linkwatch.read(written(tmp_path, "c.vtk", vtk(lines=edges)))
    assert frames.summary.left_out == ["1 set of edges with branches (at point 3)"]


def test_edges_that_share_no_point_are_joined_beside_others(tmp_path):
    """Regression test: edges were joined by equal coordinates only if no two shared a point."""
    points = np.vstack([POINTS[:12], *(POINTS[[a, b]] for a, b in EDGES[12:])])
    edges = [*EDGES[:12], *((12 + 2 * k, 13 + 2 * k) for k in range(12))]
    text = vtk(lines=edges).replace("POINTS 24", f"POINTS {len(points)}")
    text = text.replace(rows(POINTS), rows(points))
    (frame,) = linkwatch.read(written(tmp_path, "a.vtk", text))
    assert frame.counts == [-12, -12]


@pytest.mark.parametrize("binary", [False, True])
def test_texts_and_metadata_in_fields_of_vtk_files_are_skipped(tmp_path, binary):
    text = vtk_binary() if binary else vtk().encode()
    head, mark, rest = text.partition(b"DATASET POLYDATA\n")
    texts = b"\xc3one\x80\x06second" if binary else b"one\nsecond"
    field = b"FIELD FieldData 1\nnames 1 2 string\n" + texts + b"\nMETADATA\nINFORMATION 0\n\n"
    path = written(tmp_path, "a.vtk", head + mark + field + rest)
    assert [frame.counts for frame in linkwatch.read(path)] == [[-12, -12]]


def test_what_the_command_leaves_out_of_an_obj_is_left_out(tmp_path):
    """Regression test: half a ring was read as a whole one, without any message."""
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in POINTS)
    ring = " ".join(str(k + 1) for k in [*range(12), 0])
    knots = " ".join(map(str, [0, *range(13), 12]))
    text = f"{vertices}l {ring}\ncstype bspline\ndeg 1\ncurv 0 {{}} {ring}\nparm u {knots}\nend\n"
    path = written(tmp_path, "a.obj", text.format(12) + "curv2 1 2\ncall b.obj\n")
    frames = linkwatch.read(path, format="obj")
    assert [frame.counts for frame in frames] == [[-12, -12]]
    assert frames.summary.left_out == [
        "1 curve on a surface (curv2) (line 31: 'curv2')",
        "1 unknown statement (line 32: 'call')",
    ]
    (frame,) = linkwatch.read(written(tmp_path, "b.obj", text.format(6)), format="obj")
    assert frame.counts == [-36, 19] and frame.basis == "bezier"
    np.testing.assert_allclose(frame.positions[-1], POINTS[6], atol=1e-6)


def test_compressed_files_take_the_options_of_plain_ones(tmp_path):
    """Regression test: options and companion files did not reach the reader of the plain file."""
    text = "".join(f"{x},{y},{z}\n" for x, y, z in POINTS)
    path = tmp_path / "a.csv.gz"
    path.write_bytes(gzip.compress(text.encode()))
    code, out, err = run("certify", path, "--counts=-12,-12")
    assert code == 0 and out == "2 # lines: 1\n0,1,-1\n", (out, err)
    atoms = "".join(f"{k + 1} 1 1 {x} {y} {z}\n" for k, (x, y, z) in enumerate(POINTS))
    bonds = "".join(f"{k + 1} 1 {a + 1} {b + 1}\n" for k, (a, b) in enumerate(EDGES))
    box = "".join(f"-9 9 {x}lo {x}hi\n" for x in "xyz")
    data = f"rings\n\n24 atoms\n24 bonds\n\n{box}\nAtoms # bond\n\n{atoms}\nBonds\n\n{bonds}"
    written(tmp_path, "melt.data", data)
    step = "ITEM: TIMESTEP\n{}\nITEM: NUMBER OF ATOMS\n24\nITEM: BOX BOUNDS ff ff ff\n-9 9\n-9 9\n"
    rows_ = "".join(f"{k + 1} {x} {y} {z}\n" for k, (x, y, z) in enumerate(POINTS))
    dump = "".join(f"{step}-9 9\nITEM: ATOMS id x y z\n{rows_}".format(k) for k in (0, 10))
    packed = tmp_path / "melt.dump.gz"
    packed.write_bytes(gzip.compress(dump.encode()))
    assert [frame.counts for frame in linkwatch.read(packed)] == [[-12, -12]] * 2
    bonds = tmp_path / "bonds.data.gz"
    bonds.write_bytes(gzip.compress(data.encode()))
    for more in ([], ["--bonds", bonds], [f"--bonds={bonds}", "--each"], ["--each"]):
        code, out, err = run("check", packed, *more)
        assert code == 0 and '"verified":2' in out or "2 frames verified" in out, (out, err)
    # A compressed file that is there already is no input.
    code, out, err = run("convert", path, packed, "--force", "--counts=-12,-12")
    assert code == 2 and packed.exists(), (out, err)


def test_what_later_files_leave_out_is_said(tmp_path):
    plain = vtk(lines=EDGES)
    written(tmp_path, "f1.vtk", plain)
    written(tmp_path, "f2.vtk", vtk(lines=[*EDGES, (3, 4, 3)]))
    frames = linkwatch.read(tmp_path / "f1.vtk", tmp_path / "f2.vtk")
    assert frames.summary.left_out == []
    for _ in range(2):
        assert len(list(frames)) == 2
        (said,) = frames.summary.left_out
        assert said == f"{tmp_path / 'f2.vtk'}: 1 line that returns after two points (line 24)"
    linkwatch.write(frames, tmp_path / "out.npz")
    assert run("certify", tmp_path / "out.npz")[0] == 3


def test_edges_that_share_no_point_are_joined_by_their_places(tmp_path):
    points = POINTS[np.ravel(EDGES)]
    text = vtk(lines=[(2 * k, 2 * k + 1) for k in range(24)])
    text = text.replace(f"POINTS 24 float\n{rows(POINTS)}", f"POINTS 48 float\n{rows(points)}")
    frames = linkwatch.read(written(tmp_path, "a.vtk", text))
    assert "edges whose ends have equal coordinates are joined" in str(frames.summary)
    (frame,) = frames
    assert len(linkwatch.certify(frame.positions, frame.counts).links) == 1


@pytest.mark.parametrize(
    "name, content, words",
    [
        ("a.vtk", vtk()[:400], "line 27: the file ends after 55 of 72 numbers"),
        ("a.vtk", vtk().replace("\n1 0 0\n", "\n1 zero 0\n"), "could not convert"),
        ("a.vtk", vtk().replace("POLYDATA", "STRUCTURED_GRID"), "POLYDATA and UNSTRUCTURED_GRID"),
        ("a.vtk", vtk().replace("LINES 2 28", "LINES 3 28"), "28 numbers do not hold 3 cells"),
        ("a.vtk", vtk(lines=[[0, 1, 24]]), "line 0 has points beyond the 24 points"),
        ("a.vtk", vtk_binary()[:300], "the file ends before 72 numbers"),
        ("a.vtk", "solid x", "not a legacy VTK file"),
        ("a.vtp", vtp()[:-30], "not a valid VTK file"),
        ("a.vtp", vtp("appended")[:900], "array Points: 221 of 580 bytes"),
        ("a.vtp", vtp("binary").replace(b"PolyData", b"ImageData"), "type ImageData"),
        ("a.ply", ply()[:500], "element face: 0 of 1 elements|element vertex"),
        ("a.ply", ply("binary_big_endian")[:-1], "element edge: buffer is smaller"),
        (
            "a.ply",
            ply().replace(b"property int vertex1", b"property list vertex1"),
            "line 11: prop",
        ),
        ("a.ply", b"ply\nformat ascii 1.0\n", "no header from `ply` to `end_header`"),
        ("coils.a", coils().replace("periods 2", "# coils"), "line 1: expected `periods N`"),
        ("coils.a", coils().replace("end\n", ""), "the file ends without a line `end`"),
        ("coils.a", coils().replace(" 0.0 1 lower", " 1.0"), "the file ends before a line with"),
        ("coils.a", coils().replace("1 0 0 100.0", "1 0 O 100.0"), "line 4: expected 4 numbers"),
        # Regression tests: the first point, or the second block, was dropped without a message.
        ("coils.a", coils().replace("mirror NIL\n", ""), "line 3: a point in the header"),
        ("coils.a", coils() + coils(), "line 31: text after `end`: keep one block"),
        # Regression test: of two points with one number, the first was dropped without a message.
        ("a.poly", poly().replace("3: ", "2: ", 1), "line 4: a second point with the number 2"),
        ("a.poly", poly().replace("END", ""), "the file ends without a line END"),
        (
            "a.poly",
            poly().replace("1: 1 2 3 4 5 6 7 8 9 10 11 12 <", "1: 1 2 <"),
            "line 27: a poly",
        ),
        ("a.poly", poly().replace("24 <", "25 <"), "line 28: there is no point 25"),
        ("a.poly", "24 3 0 0\n1 0 0 0\n", "line 1: expected `NUMBER: ..` below POINTS"),
        ("a.hair", hair()[:-1], "the file ends at byte 547, expected 548"),
        ("a.hair", b"HAIR" + bytes(124), "no array of points"),
        ("a.data", usc()[:-4], "byte 324: strand 2 has 1 points, which do not fit"),
        ("a.data", usc() + b"1234", "expected 340 for its strands"),
        ("a.tg3", tg3()[:-9], "not a valid TexGen model"),
        ("a.tg3", tg3().replace("1, 0, 0", "1, 0"), "yarn 0: MasterNode has Position '1, 0'"),
        ("a.tg3", "<TexGenModel><Textile/></TexGenModel>", "saved with minimal output"),
        ("a.pvd", "<a><DataSet file='b'/></a>", "not a valid collection"),
        # Regression tests: a traceback, and an array from the end of the file.
        ("a.vtp", vtp().replace(b">0 1 2 ", b">0 99999999999999999999 2 "), "connectivity: "),
        ("a.vtp", vtp("appended-raw").replace(b'offset="0"', b'offset="-9"'), "offset -9"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, name, content, words):
    path = written(tmp_path, name, content)
    with pytest.raises(ValueError, match=words) as error:
        linkwatch.read(path)
    assert str(error.value).startswith(str(path))
    code, out, err = run("convert", path, tmp_path / "out.npz")
    assert (code, out) == (2, "") and err.startswith(f"error: {path}"), (out, err)
    assert list(tmp_path.iterdir()) == [path]


def test_options_that_a_format_does_not_have_are_refused(tmp_path):
    path = written(tmp_path, "a.vtk", vtk())
    with pytest.raises(ValueError, match="`select` is no option for files of the format vtk"):
        linkwatch.read(path, select="all")
    with pytest.raises(ValueError, match="format is 'abc', expected one of usd, oxdna"):
        linkwatch.read(path, format="abc")
    assert len(linkwatch.read(path.rename(tmp_path / "a.txt"), format="vtk")) == 1


# A weave of four yarns in a cell of 2 x 2.
WEAVE = [[(x, y, 0.3 * (-1) ** (k + x)) for x in range(3)] for k, y in enumerate((0.5, 1.5))] + [
    [(x, y, 0.3 * (-1) ** (k + y + 1)) for y in range(3)] for k, x in enumerate((0, 1))
]


@pytest.mark.parametrize("kind", ["Linear", "Cubic", "Bezier"])
def test_yarns_of_texgen_run_through_their_cell(tmp_path, kind):
    repeats = [(2, 0, 0), (0, 2, 0)]
    frames = linkwatch.read(written(tmp_path, "a.tg3", tg3(kind, repeats, WEAVE)))
    (frame,) = frames
    assert "the cell has the 2 repeat vectors of the yarns" in str(frames.summary)
    assert frame.basis == ("polyline" if kind == "Linear" else "bezier")
    np.testing.assert_array_equal(frame.cell, np.diag([2, 2, 0, 0])[:, :3])
    assert frame.names == [f"yarn {k}" for k in range(4)]
    session = linkwatch.Session(frame.counts, basis=frame.basis, names=frame.names)
    report = session.step(frame.positions, cell=frame.cell)
    assert report.intact, report


@pytest.mark.parametrize("periodic", [0, 1])
def test_cubic_yarns_are_the_spline_of_texgen(tmp_path, periodic):
    scipy = pytest.importorskip("scipy.interpolate", reason="scipy is not installed")
    nodes = np.random.default_rng(1).normal(size=(6, 3))
    if periodic:
        nodes[-1] = nodes[0]
    text = tg3("Cubic", [(9, 0, 0)], [nodes], periodic)
    (frame,) = linkwatch.read(written(tmp_path, "a.tg3", text))
    rule = "periodic" if periodic else "natural"
    spline = scipy.CubicSpline(range(6), nodes, bc_type=rule)
    p = frame.positions.reshape(-1, 3)
    for k in range(5):
        a, b, c, d = p[3 * k : 3 * k + 4]
        np.testing.assert_allclose((a + 3 * b + 3 * c + d) / 8, spline(k + 0.5), atol=1e-8)


def test_an_unknown_interpolation_is_counted(tmp_path):
    text = tg3("Cubic").replace("CInterpolationCubic", "CInterpolationAdjusted", 1)
    frames = linkwatch.read(written(tmp_path, "a.tg3", text))
    expected = "1 yarn that is not read (yarn 0: interpolation CInterpolationAdjusted)"
    assert frames.summary.left_out == [expected]


def test_formats_of_meshio_are_read(tmp_path):
    needs("meshio")
    import meshio

    cells = [("line", EDGES), ("triangle", [[0, 1, 2]]), ("line3", [[0, 1, 2]])]
    path = tmp_path / "a.msh"
    meshio.Mesh(POINTS, cells).write(path, "gmsh22", binary=False)
    frames = linkwatch.read(path)
    (frame,) = frames
    assert linkwatch.certify(frame.positions, frame.counts).links == [(0, 1, -1)]
    assert frames.summary.left_out == ["1 curved line (line3)"]
    with pytest.raises(ValueError, match="meshio cannot read this mesh"):
        linkwatch.read(written(tmp_path, "b.msh", "solid x"))


def abaqus(*parts, end=""):
    """Returns an Abaqus file with a ring for each part."""
    text = "*HEADING\nrings\n"
    for ring, first in parts:
        points = enumerate(ring, first)
        nodes = "".join(f"{k}, {x:.6f}, {y:.6f}, {z:.6f}\n" for k, (x, y, z) in points)
        pairs = [(k + first, (k + 1) % 12 + first) for k in range(12)]
        elements = "".join(f"{a}, {a}, {b}\n" for a, b in pairs)
        text += f"*Node\n{nodes}*ELEMENT, TYPE=B31\n{elements}"
    return text + end


def nastran(element="CROD,{k},1,{a},{b}", end="ENDDATA\n"):
    """Returns a Nastran file with two rings, the second one of an element."""
    text = "SOL 101\nCEND\nBEGIN BULK\n"
    for k, (x, y, z) in enumerate(POINTS, 1):
        text += f"GRID,{k},,{x:.5f},{y:.5f},{z:.5f}\n"
    for k, (a, b) in enumerate(EDGES, 1):
        one = element if k > 12 else "CROD,{k},1,{a},{b}"
        text += one.format(k=k, a=a + 1, b=b + 1) + "\n"
    return text + end


@pytest.mark.parametrize(
    "name, content, words",
    [
        # Regression tests: points of another part, or in another coordinate system, were read.
        ("a.inp", abaqus((RING, 1), (OTHER, 1)), r"line 29: \*Node is not read: write a flat file"),
        ("a.inp", abaqus((RING, 1), (OTHER, 13)), r"line 29: \*Node is not read"),
        ("a.inp", abaqus((RING, 1), end="*Instance, name=A, part=B\n"), r"\*Instance, .* not read"),
        ("a.inp", abaqus((RING, 1)).replace("*Node", "*NODE, SYSTEM=C"), "SYSTEM=C is not read"),
        ("a.inp", abaqus((RING, 1), end="*INCLUDE, INPUT=b.inp\n"), "b.inp is not read"),
        ("a.bdf", nastran().replace("GRID,3,,", "GRID,3,8,"), "GRID,3,8,.* is not read: write one"),
        ("a.bdf", nastran().replace("CROD,1,", "GRDSET,,8\nCROD,1,"), "GRDSET,,8 is not read"),
        ("a.bdf", nastran(end="INCLUDE 'b.bdf'\nENDDATA\n"), "INCLUDE 'b.bdf' is not read"),
        # Regression test: meshio looped forever.
        ("a.bdf", "SOL 101\nCEND\nBEGIN BULK", "no cards after BEGIN BULK"),
        ("a.bdf", "SOL 101\nCEND\nBEGIN BULK\n$ comment\n", "no cards after BEGIN BULK"),
        # Regression tests: errors of meshio were raised as other types, with the text `1`.
        ("a.inp", abaqus((RING, 1)).replace("1, 1, 2", "1, 1, 77"), "this mesh: KeyError: .*77"),
        ("a.inp", abaqus((RING, 1)).replace("B31", "B99"), "Element type not available: B99"),
        ("a.bdf", nastran(end=""), "this mesh: Premature EOF"),
        ("a.mesh", "", "meshio cannot read this mesh: "),
    ],
)
def test_a_mesh_that_meshio_cannot_read_is_refused(tmp_path, name, content, words):
    needs("meshio")
    path = written(tmp_path, name, content)
    with pytest.raises(ValueError, match=words) as error:
        linkwatch.read(path)
    assert str(error.value).startswith(str(path))


def test_a_file_that_cannot_be_read_has_no_verdict(tmp_path):
    # Regression test: an exception gave the exit code that means a changed topology.
    needs("meshio")
    path = written(tmp_path, "a.inp", abaqus((RING, 1)).replace("1, 1, 2", "1, 1, 77"))
    for words in (["check"], ["certify"], ["measure", "writhe"]):
        code, _, err = run(*words, path)
        assert code == 2 and "this mesh: KeyError: " in err.splitlines()[-1], (words, code, err)
    code, out, _ = run("check", "--each", "--json", path)
    assert code == 2 and "KeyError: " in json.loads(out.splitlines()[0])["error"], out


@pytest.mark.parametrize("kind", [KeyError, MemoryError, BaseException])
def test_an_exception_ends_the_command_with_2(monkeypatch, capsys, kind):
    def fail(*_):
        raise kind("a\nb")

    monkeypatch.setattr("linkwatch._command.command", fail)
    monkeypatch.setattr("sys.argv", ["linkwatch", "certify", "a.bcc"])
    assert main() == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith(f"error: {kind.__name__}: ")


@pytest.mark.parametrize(
    "element, raw",
    [
        ("CTUBE,{k},1,{a},{b}", "CTUBE"),
        ("CELAS2,{k},1.0,{a},1,{b},1", "CELAS2"),
        ("PLOTEL,{k},{a},{b}", "PLOTEL"),
        ("CROD*,{k},1,{a},{b}", r"CROD\*"),
        ("ctube,{k},1,{a},{b}", "ctube"),
    ],
)
def test_elements_of_nastran_that_are_not_read_are_counted(tmp_path, element, raw):
    needs("meshio")
    frames = linkwatch.read(written(tmp_path, "a.bdf", nastran(element)))
    assert next(iter(frames)).counts == [-12]
    (said,) = frames.summary.left_out
    assert re.match(rf"12 elements {raw} \(the first one: {raw},13,", said)
    whole = linkwatch.read(written(tmp_path, "b.bdf", nastran()))
    assert next(iter(whole)).counts == [-12, -12] and not whole.summary.left_out


def test_blocks_of_lz4_are_read(tmp_path, monkeypatch):
    block = pytest.importorskip("lz4.block", reason="lz4 is not installed")
    monkeypatch.setitem(PACKERS, "LZ4", lambda data: block.compress(data, store_size=False))
    (frame,) = linkwatch.read(written(tmp_path, "a.vtp", vtp("appended", "LZ4")))
    assert linkwatch.certify(frame.positions, frame.counts).links == [(0, 1, -1)]


@pytest.mark.parametrize("how", [{}, {"binary": False}, {"compression": None}])
@pytest.mark.parametrize("name", ["a.vtk", "a.vtu"])
def test_lines_that_meshio_writes_are_read(tmp_path, name, how):
    needs("meshio")
    import meshio

    if name == "a.vtk" and "compression" in how:
        how = {"file_format": "vtk42"}
    cells = [("line", EDGES), ("triangle", [[0, 1, 2]])]
    meshio.Mesh(POINTS, cells).write(tmp_path / name, **how)
    (frame,) = linkwatch.read(tmp_path / name)
    assert linkwatch.certify(frame.positions, frame.counts).links == [(0, 1, -1)]


TEXT = {
    "a.txt": rows(RING) + "\n" + rows(OTHER),
    "a.csv": "x,y,z,curve\n" + "".join(
        f"{x:.7g},{y:.7g},{z:.7g},{k // 12}\n" for k, (x, y, z) in enumerate(POINTS)
    ),
    "a.obj": "".join(f"v {row}\n" for row in rows(POINTS).splitlines())
    + "".join(f"l {' '.join(str(i + 1) for i in loop)}\n" for loop in LOOPS),
}  # fmt: skip


@pytest.mark.parametrize("name", TEXT)
def test_formats_of_the_command_are_read(tmp_path, name):
    path = written(tmp_path, name, TEXT[name])
    frames = linkwatch.read(path, closed=None if name == "a.obj" else True)
    for _ in range(2):
        (frame,) = frames
        assert frame.counts == [-12, -12]
        assert linkwatch.certify(frame.positions, frame.counts).links == [(0, 1, -1)]
    with pytest.raises(ValueError, match="a.raw.*option `closed`"):
        linkwatch.read(written(tmp_path, "a.raw", rows(RING)))


def test_archives_are_read_back(tmp_path):
    cell = np.vstack([10 * np.eye(3), np.zeros(3)])
    given = [
        io.Frame(POINTS + k, [-12, -12], "polyline", ["a", "b"], [0.1, 0.2], cell, 2 * k, 0.5 * k)
        for k in range(3)
    ]
    given[1] = given[0].invalid("torn", seq=2, time=0.5)
    linkwatch.write(given, tmp_path / "a.npz")
    found = linkwatch.read(tmp_path / "a.npz")
    read = list(found)
    assert len(found) == len(read) == 3
    for one, other in zip(read[::2], given[::2]):
        np.testing.assert_array_equal(one.positions, other.positions)
        np.testing.assert_array_equal(one.cell, cell)
        assert (one.seq, one.time, one.counts) == (other.seq, other.time, other.counts)
        assert one.names == ["a", "b"]
        assert one.radii == pytest.approx([0.1, 0.2])
    assert (read[1].seq, read[1].time, read[1].counts) == (2, 0.5, [-12, -12])
    assert "curve 0, point 0: coordinate x is NaN" in read[1].rejected
    (said,) = found.summary.rejected
    assert "frame 2 is invalid: curve 0, point 0" in said


def test_what_the_command_leaves_out_is_said(tmp_path):
    text = TEXT["a.obj"] + "curv2 1 2\n"
    frames = linkwatch.read(written(tmp_path, "a.obj", text))
    assert "curv2" in str(frames.summary.left_out)
    linkwatch.write(frames, tmp_path / "b.npz")
    assert run("certify", tmp_path / "b.npz")[0] == 3


def exploded(curves):
    """Returns a VTK file of edges, each with separate points."""
    ends = [np.stack([curve, np.roll(curve, -1, axis=0)], axis=1) for curve in curves]
    points = np.concatenate(ends).reshape(-1, 3)
    edges = np.arange(len(points)).reshape(-1, 2)
    header = f"# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS {len(points)} double"
    numbers = "".join(f"{x:.17g} {y:.17g} {z:.17g}\n" for x, y, z in points)
    lines = "".join(f"2 {a} {b}\n" for a, b in edges)
    return f"{header}\n{numbers}LINES {len(edges)} {3 * len(edges)}\n{lines}"


def test_edges_with_points_of_their_own_are_the_same_curves_in_all_frames(tmp_path):
    # Regression test: the coordinates decided the order and the direction of the curves.
    files = []
    for k in range(12):
        c, s = np.cos(0.5 * k), np.sin(0.5 * k)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        files.append(tmp_path / f"{k}.vtk")
        files[-1].write_text(exploded([one @ turn for one in (RING, OTHER, OTHER + [4, 0, 0])]))
    run = linkwatch.check(files, motion_limit=10.0)
    assert run.verdict == "intact", run.summary
    linked = {str(linkwatch.certify(f.positions, f.counts).links) for f in linkwatch.read(*files)}
    assert len(linked) == 1, linked


def test_names_with_decimal_numbers_are_in_the_order_of_the_command(tmp_path):
    names = ["2/t10.vtk", "2/t9.5.vtk", "10/t0.1.vtk", "10/t0.2.vtk", "10/t0.15.vtk"]
    ordered = ["2/t9.5.vtk", "2/t10.vtk", "10/t0.1.vtk", "10/t0.15.vtk", "10/t0.2.vtk"]
    for name in names:
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(exploded([RING + [ordered.index(name), 0, 0]]))
    frames = linkwatch.read(*(tmp_path / name for name in names))
    assert [round(frame.positions[0, 0] - RING[0, 0]) for frame in frames] == [0, 1, 2, 3, 4]
    assert "by the numbers in their names, not as they are given" in str(frames.summary)


def test_files_keep_their_order_on_request(tmp_path):
    """Regression test: the command ignored --keep-order for files of the package."""
    for kind in ("vtk", "obj"):
        paths = [tmp_path / f"{k}.{kind}" for k in (2, 1)]
        for k, path in enumerate(paths):
            line = f"v {k + 1} 0 0\nv 0 1 0\nv 0 0 1\nl 1 2 3 1\n"
            path.write_text(exploded([RING + [k, 0, 0]]) if kind == "vtk" else line)
        for keep_order, expected in ((True, [1, 2]), (False, [2, 1])):
            frames = linkwatch.read(*paths, keep_order=keep_order)
            assert [round(frame.positions[0, 0], 3) for frame in frames] == expected
    paths = [written(tmp_path, f"{k}.ply", ply()) for k in (3, 2, 1)]
    moved = POINTS + np.repeat([[0, 0, 0], [2.5, 0, 0]], 12, axis=0)
    paths[2].write_bytes(ply().replace(rows(POINTS).encode(), rows(moved).encode()))
    for more, number in (([], 0), (["--keep-order"], 2)):
        code, out, err = run("check", *paths, "--events=off", *more)
        baseline = "came apart: linking number was -1, is 0" in out
        assert code == 1 and baseline == (number == 2), (out, err)


def test_files_of_the_package_and_others_are_frames_in_the_order_that_is_given(tmp_path):
    """Regression test: files that only the command reads always came first."""
    path = written(tmp_path, "a.ply", ply())
    moved = POINTS + np.repeat([[0, 0, 0], [9, 0, 0]], 12, axis=0)
    vertices = "".join(f"v {row}\n" for row in rows(moved).splitlines())
    lines = "".join("l " + " ".join(str(k + 1) for k in loop) + "\n" for loop in LOOPS)
    other = written(tmp_path, "b.obj", vertices + lines)
    for files, change in (((path, other), "was -1, is 0"), ((other, path), "was 0, is -1")):
        code, out, err = run("check", *files, "--events=off")
        assert code == 1 and change in out and f"{files[1]}: " in out, (out, err)
    # Regression test: the option joined two rings that are separate in the file.
    for option in ("--counts=-24", "--counts"):
        code, out, err = run("check", path, path, option, *["-24"] * (option == "--counts"))
        assert (code, out) == (2, "") and "`--counts`, which this format does not have" in err


@pytest.mark.parametrize(
    "names",
    [["start", "end"], ["run", "md"], ["t_-1", "t_0", "t_1"], ["t1", "u0"], ["b/t1", "a/t1"]],
)
def test_files_whose_names_differ_by_more_than_numbers_have_the_order_that_is_given(
    tmp_path, names
):
    # Regression test: such files were sorted by their names.
    paths = [tmp_path / f"{name}.vtk" for name in names]
    for k, path in enumerate(paths):
        path.parent.mkdir(exist_ok=True)
        path.write_text(exploded([RING + [k, 0, 0]]))
    frames = linkwatch.read(*paths)
    assert [round(frame.positions[0, 0] - RING[0, 0]) for frame in frames] == [*range(len(names))]
    assert "by the numbers" not in str(frames.summary)


def test_the_command_checks_all_frames_if_curves_change(tmp_path):
    # Regression test: only the frames before the change were checked, and the run was intact.
    for k in range(6):
        curves = [RING, OTHER + [0.5 * k, 0, 0], OTHER + [9, 0, 0]][: 2 + (k > 1)]
        (tmp_path / f"{k}.vtk").write_text(exploded(curves))
    files = [str(tmp_path / f"{k}.vtk") for k in range(6)]
    code, out, err = run("check", *files)
    assert code == 3 and "the curves changed between frames" in out, (code, out, err)
    assert "files: check them with" not in err
    code, out, err = run("certify", *files)
    assert code == 0 and [out.count(f"{k} curves") for k in (2, 3)] == [2, 4], (out, err)
    archives = [str(tmp_path / name) for name in ("a.npz", "a-2.npz")]
    code, out, err = run("convert", "--json", *files, archives[0])
    assert code == 0 and json.loads(out)["files"] == archives, (out, err)
    again, out, err = run("check", *archives, "--one-motion")
    assert again == 3 and "the curves changed between frames" in out, (again, out, err)


def test_a_check_keeps_curves_open_that_the_reader_keeps_open(tmp_path):
    # Regression test: the session closed the curves in spite of the option.
    path = written(tmp_path, "coils.a", coils())
    for run_ in (
        linkwatch.check([path, path], closed=False),
        linkwatch.check(linkwatch.read(path, path, closed=False)),
        linkwatch.check(linkwatch.read(path, path, keep_open=True)),
    ):
        assert "2 open curves" in run_.summary, run_.summary
    assert "open" not in linkwatch.check([path, path]).summary
    code, out, err = run("check", path, path, "--closed=false", "--keep-open")
    assert code == 0 and "2 open curves" in out, (out, err)
    code, out, err = run("check", path, path, "--closed=false")
    assert code == 0 and "2 open curves" in out, (out, err)


def test_a_check_takes_coordinates_as_they_are_if_the_reader_does(tmp_path):
    """Regression test: the check moved a curve back that had jumped to another image."""
    needs("MDAnalysis")
    cell = "CRYST1   10.000   11.000   12.000  90.00  90.00  90.00 P 1           1\n"
    paths = []
    for k, shift in enumerate((0, 10)):
        points = POINTS + np.repeat([[0, 0, 0], [shift, 0, 0]], 12, axis=0)
        atoms = "".join(
            f"ATOM  {i + 1:5}  C   RNG {'AB'[i // 12]}   1    {x:8.3f}{y:8.3f}{z:8.3f}  1.00\n"
            for i, (x, y, z) in enumerate(points)
        )
        bonds = "".join(f"CONECT{a + 1:5}{b + 1:5}\n" for a, b in EDGES)
        paths.append(written(tmp_path, f"F{k}.pdb", f"{cell}{atoms}{bonds}END\n"))
    assert run("check", *paths)[0] == 0
    code, out, err = run("check", *paths, "--wrapped=false")
    assert code == 1 and "passed through" in out, (out, err)


@pytest.mark.parametrize("option", ["closed", "unwrap", "keep_open", "one_motion"])
def test_flags_of_read_are_true_or_false(tmp_path, option):
    # Regression test: the text "false" counted as true.
    path = written(tmp_path, "coils.a", coils())
    for value in ("false", 0):
        with pytest.raises(TypeError, match=f"{option} is .*, expected True or False"):
            linkwatch.read(path, **{option: value})
    assert next(iter(linkwatch.read(path, closed=np.False_))).counts == [13, 13]


def test_files_that_do_not_say_it_have_counts(tmp_path):
    # Regression test: the message named an option that `read` and `check` did not have.
    np.save(tmp_path / "a.npy", np.array([POINTS, POINTS]))
    text = written(tmp_path, "a.txt", rows(POINTS))
    atoms = "".join(f"C {row}\n" for row in rows(POINTS).splitlines())
    xyz = written(tmp_path, "a.xyz", f"24\nProperties=species:S:1:pos:R:3\n{atoms}")
    for path in (tmp_path / "a.npy", text, xyz):
        for frame in linkwatch.read(path, counts=[-12, -12]):
            assert linkwatch.certify(frame.positions, frame.counts).links == [(0, 1, -1)]
    assert linkwatch.check(tmp_path / "a.npy", counts=np.array([-12, -12])).verdict == "intact"
    assert linkwatch.linking(text, counts=[-12, -12], pairs=[(0, 1)]).tolist() == [[-1]]
    with pytest.raises(ValueError, match=r"option `counts`"):
        linkwatch.read(tmp_path / "a.npy")
    with pytest.raises(ValueError, match="`counts` is no option for files of the format ply"):
        linkwatch.read(written(tmp_path, "a.ply", ply()), counts=[-12, -12])


def test_a_topic_of_an_mcap_file_is_chosen():
    path = pathlib.Path(__file__).parents[3] / "recordings/others/markers.mcap"
    with pytest.raises(ValueError, match="no topic /x; its topics: /markers"):
        linkwatch.read(path, topic="/x")


def test_files_that_continue_one_another_are_one_motion(tmp_path):
    # Regression test: the message named an option of the command.
    frames = [
        io.Frame(POINTS[: 12 * n] + [k, 0, 0], [-12] * n, names=["a", "b"][:n], seq=k, time=k)
        for k, n in enumerate((2, 2, 1, 1))
    ]
    paths = linkwatch.write(frames, tmp_path / "run.npz")
    assert len(paths) == 2
    with pytest.raises(ValueError, match="pass the option `one_motion`"):
        linkwatch.read(*paths)
    found = linkwatch.read(*paths, one_motion=True)
    assert len(found) == 4
    for _ in range(2):
        for one, frame in zip(found, frames):
            assert (one.seq, one.time, one.names) == (frame.seq, frame.time, frame.names)
            np.testing.assert_array_equal(one.positions, frame.positions)
    assert [one.seq for one in pickle.loads(pickle.dumps(found))] == [0, 1, 2, 3]
    again = linkwatch.read(paths[1], paths[0], one_motion=True)
    assert [(one.seq, one.time) for one in again] == [(2, 2), (3, 3), (4, 0), (5, 1)]
    assert [row["frame"] for row in linkwatch.check(paths, one_motion=True).frames] == [0, 1, 2, 3]


def parts(tmp_path, *cuts):
    """Writes two parts of a motion. A strand passes another one in the step between them."""
    along = np.array([[x, 0, 0] for x in (-2, -1, 0, 1, 2)], float)
    across = np.array([[0.35, y, 0] for y in (-2, -1, 0, 1, 2)])
    paths = []
    for name, heights, given in zip(("a.npz", "b.npz"), ((0.5, 0.3), (-0.3, -0.5)), cuts):
        positions = np.array([np.concatenate([along, across + [0, 0, z]]) for z in heights])
        others = {} if given is None else {"cuts": given}
        np.savez(tmp_path / name, positions=positions, counts=[5, 5], **others)
        paths.append(tmp_path / name)
    return paths


def test_cuts_of_files_that_continue_one_another(tmp_path):
    # Regression tests: Python counted a file without cuts as a cut, and the command ignored a cut
    # between two files.
    for cuts, code in (
        ((None, None), 1),
        (([0, 1], None), 1),
        (([0, 1], [0, 0]), 1),
        (([1, 1], [1, 1]), 1),
        (([0, 0], [1, 1]), 0),
        (([0, 1], [2, 2]), 0),
    ):
        paths = parts(tmp_path, *cuts)
        ended = run("check", "--one-motion", "--events", *paths)
        assert ended[0] == code, (cuts, ended)
        frames = linkwatch.read(*paths, one_motion=True)
        assert linkwatch.check(frames).verdict == ("changed" if code else "intact"), cuts
        for path in linkwatch.write(frames, tmp_path / "out.npz", force=True):
            assert linkwatch.check(path).verdict == ("changed" if code else "intact"), cuts


def test_a_recorded_run_that_lacks_a_file_is_incomplete(tmp_path):
    # Regression test: the step over the gap was searched, and the run was intact.
    scene = ("generate", "chainmail:rows=12,columns=12", "--frames", "30,diameter=0.2")
    assert run(*scene, "-o", tmp_path / "run.npz")[0] == 0
    record = f"{tmp_path / 'run.mcap'},max=1MB"
    assert run("check", tmp_path / "run.npz", "--events", "--record", record)[0] == 0
    first, second, third = (tmp_path / f"run{k}.mcap" for k in ("", "-part2", "-part3"))
    frames = linkwatch.read(first, second, third, one_motion=True)
    assert linkwatch.check(frames, events="off").verdict == "intact"
    frames = linkwatch.read(first, third, one_motion=True)
    assert len({frame.cuts for frame in frames}) == 2
    found = linkwatch.check(frames, events="off")
    assert found.verdict == "incomplete" and "before run-part3.mcap" in found.summary
    # What happened in the first or in the last file was not said.
    for files in ([second, third], [second], [first, second]):
        frames = linkwatch.read(*files, one_motion=True)
        assert linkwatch.check(frames, events="off").verdict == "incomplete"
    assert "files of the run after run.mcap" in str(linkwatch.read(first).summary)


def test_a_part_of_a_motion_keeps_its_cuts(tmp_path):
    # Regression test: cuts that are the same in all frames of a file were not written.
    frames = [io.Frame(POINTS + [k, 0, 0], [-12, -12], seq=k, cuts=1) for k in range(2)]
    (path,) = linkwatch.write(frames, tmp_path / "run.npz")
    assert [frame.cuts for frame in linkwatch.read(path)] == [1, 1]
    again = tmp_path / "again.npz"
    assert run("convert", path, again)[0] == 0
    assert np.load(again)["cuts"].tolist() == [1, 1]


def test_single_quotes_and_empty_times_in_xml_files_of_vtk(tmp_path):
    # Regression tests: raw data was decoded as base64, and an IndexError had no message.
    content = vtp("appended").replace(b'"raw"', b"'raw'").replace(b">0.25<", b"><")
    (frame,) = linkwatch.read(written(tmp_path, "a.vtp", content))
    assert frame.time == 0
    assert linkwatch.certify(frame.positions, frame.counts).links == [(0, 1, -1)]


def test_curves_stay_open_on_request_whatever_reads_their_file(tmp_path):
    # Regression test: the readers of the package ignored `keep_open`.
    path = written(tmp_path, "coils.a", coils())
    assert next(iter(linkwatch.read(path))).counts == [-12, -12]
    assert next(iter(linkwatch.read(path, keep_open=True))).counts == [13, 13]
    summary = linkwatch.check([path, path], keep_open=True).summary
    assert "2 open curves" in summary
    archive = tmp_path / "out.npz"
    assert run("convert", "--keep-open", path, archive)[0] == 0
    assert np.load(archive)["counts"].tolist() == [13, 13]
    code, out, err = run("check", "--keep-open", path, path)
    assert code == 0 and "2 open curves" in out, (out, err)
    # Regression test: one of two readers left a line open that returns to its first vertex.
    path = written(tmp_path, "a.obj", TEXT["a.obj"])
    for name in (None, "obj"):
        frames = linkwatch.read(path, format=name, keep_open=True)
        assert next(iter(frames)).counts == [-12, -12]
    # Regression test: `keep_open` was ignored for files that the command reads.
    assert next(iter(linkwatch.read(archive, keep_open=True))).counts == [13, 13]
    ring = np.concatenate([RING, RING[:1]])
    apart = np.concatenate([RING, RING[:1] + [0, 0, 3]])
    np.savez(tmp_path / "opens.npz", positions=[ring, apart], counts=[len(ring)])
    found = linkwatch.check(tmp_path / "opens.npz", keep_open=True, events="all")
    assert [row["verdict"] for row in found.frames] == ["intact", "intact"], found.summary


@pytest.mark.parametrize("name", ["disp", "Displacement", "u"])
def test_points_that_an_array_may_displace_are_not_verified(tmp_path, name):
    """Regression test: a deformed mesh has the same points in all frames, and was intact."""
    values = "0 0 1 " * 24
    data = f"POINT_DATA 24\nSCALARS mass float 1\nLOOKUP_TABLE default\n{'1 ' * 24}\n"
    vectors = f"VECTORS {name} float\n{values}\n"
    field = f"FIELD attributes 1\n{name} 3 24 float\n{values}\n"
    array = f'<DataArray Name="{name}" NumberOfComponents="3" type="Float32">{values}</DataArray>'
    data_of_points = f"</Points><PointData>{array}</PointData>".encode()
    xml = vtp().replace(b"</Points>", data_of_points)
    for file, content in (("a.vtk", vtk() + data + vectors), ("b.vtk", vtk() + data + field),
                          ("a.vtp", xml)):  # fmt: skip
        frames = linkwatch.read(written(tmp_path, file, content))
        list(frames)
        assert bool(frames.summary.left_out) == (name != "u"), (file, frames.summary)
