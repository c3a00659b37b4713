"""Compares the offsets on docs/reference/bus.md with those of C and of Python's ctypes."""

import ctypes
import pathlib
import re
import shutil
import subprocess

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs/reference/bus.md").read_text()
STRUCTS = {"linkwatch_frame_header": "## A frame", "linkwatch_verdict": "## A message"}
TYPES = {
    "u8": ctypes.c_uint8,
    "u32": ctypes.c_uint32,
    "u64": ctypes.c_uint64,
    "i32": ctypes.c_int32,
    "i64": ctypes.c_int64,
    "f64": ctypes.c_double,
}


def rows(heading: str) -> list[tuple[int, int, str, str]]:
    """Returns offset, bytes, type and field of each row of the first table of a section."""
    section = PAGE.split(heading, 1)[1].split("\n## ", 1)[0]
    table = section.split("| offset |", 1)[1].split("\n\n", 1)[0]
    row = re.compile(r"^\| (\d+) \| (\d+) \| `([^`]+)` \| `([^`]+)` \|", re.MULTILINE)
    return [(int(at), int(size), kind, name) for at, size, kind, name in row.findall(table)]


@pytest.mark.parametrize("heading", STRUCTS.values())
def test_ctypes_has_the_offsets_of_the_page(heading: str) -> None:
    found = rows(heading)
    assert len(found) > 15

    def kind(text: str) -> type:
        array = re.fullmatch(r"\[(\w+); (\d+)\]", text)
        return TYPES[array[1]] * int(array[2]) if array else TYPES[text]

    class Struct(ctypes.Structure):
        _fields_ = [(name, kind(text)) for _, _, text, name in found]

    for offset, size, _, name in found:
        field = getattr(Struct, name)
        assert (field.offset, field.size) == (offset, size), name
    assert f"{ctypes.sizeof(Struct)}" in PAGE


def test_the_c_header_has_the_offsets_of_the_page(tmp_path: pathlib.Path) -> None:
    if shutil.which("cc") is None:
        pytest.skip("no C compiler (cc)")
    lines = ['#include <stddef.h>', '#include "linkwatch_wire.h"']
    for struct, heading in STRUCTS.items():
        for offset, size, _, name in rows(heading):
            lines.append(f"_Static_assert(offsetof({struct}, {name}) == {offset}, {name!r});")
            member = f"(({struct} *)0)->{name}"
            lines.append(f"_Static_assert(sizeof({member}) == {size}, {name!r});")
        last = rows(heading)[-1]
        lines.append(f'_Static_assert(sizeof({struct}) == {last[0] + last[1]}, "size");')
    source = tmp_path / "layout.c"
    source.write_text("\n".join(lines).replace("'", '"') + "\n")
    command = ["cc", "-std=c11", "-fsyntax-only", f"-I{ROOT / 'schemas'}", str(source)]
    subprocess.run(command, check=True)
