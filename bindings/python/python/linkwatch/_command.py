"""The command ``linkwatch``."""

from __future__ import annotations

import os
import pathlib
import signal
import sys
import tempfile
import traceback

from ._linkwatch import command

# Options of `convert` that are true without a value.
FLAGS = {
    "--closed": "close open curves; =false: keep open those that end where they start",
    "--wrapped": "unwrap coordinates; =false: take them as they are",
}

# Other options without a value.
SWITCHES = {
    "--",
    *FLAGS,
    *"--axis-first --each --early-exit --events --explain --force --json --keep-open".split(),
    *"--keep-order --one-motion --open --resume --skip-doubled".split(),
    *"-h --help -q --quiet -v --verbose".split(),
}

# Subcommands that read files, and options that may be before them.
SUBCOMMANDS = (["convert"], ["check"], ["certify"], ["measure"])
GENERAL = ("--json", "-q", "--quiet", "-v", "--verbose", "--threads")

# Suffixes of files that the command always reads itself: they cost no import of the readers.
OWN = (".bcc", ".npy", ".npz", ".mcap", ".obj", ".vect", ".xyz", ".extxyz", ".dump", ".lammpstrj")


def main() -> int:
    """Runs the command with the arguments of the process, and returns its exit code."""
    try:
        return _main()
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as why:  # a panic is no Exception
        # The exit code of Python is 1, which is a verdict.
        traceback.print_exc()
        said = " ".join(f"{type(why).__name__}: {why}".split())
        print(f"error: {said}: please report this, with the lines above", file=sys.stderr)
        return 2


def _main() -> int:
    """Runs the command: see :func:`main`."""
    # Replaces a closed standard stream, whose descriptor the next opened file would get.
    for stream in range(3):
        try:
            os.fstat(stream)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    # Python's own handler would take effect only when the command has ended.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    args = _in_place(sys.argv[1:])
    # With `--each`, each file is passed to a separate process, as the value of `--only`.
    each = "--each" in args and "--only" not in args
    if each and (option := _given(args, "--select", "--format")):
        return _refuse(f"{option} has no effect with --each: check each file alone")
    if each or args[:1] not in SUBCOMMANDS:
        return command(["linkwatch", *args])
    only = args.index("--only") + 1 if "--only" in args[:-1] else None
    packed = _packed(args, only)
    if not packed:
        return _run(args, only)
    from . import io

    with tempfile.TemporaryDirectory(prefix="linkwatch-") as folder:
        try:
            plain = io.unpacked(list(map(pathlib.Path, packed)), pathlib.Path(folder))
        except (OSError, ValueError) as why:
            return _refuse(str(why))
        for places, path in zip(packed.values(), plain):
            for k in places:
                # A value may follow its option in the same word.
                args[k] = args[k].removesuffix(_named(args[k])) + str(path)
        return _run(args, only)


def _in_place(args: list[str]) -> list[str]:
    """Returns arguments with the subcommand first, and ``./`` before names of files after ``--``
    that begin with a dash."""
    k = 0
    while args[k : k + 1] and (args[k] in GENERAL or args[k].startswith("--threads=")):
        k += 2 if args[k] == "--threads" else 1
    if args[k : k + 1] not in SUBCOMMANDS:
        return args
    args = [args[k], *args[:k], *args[k + 1 :]]
    end = args.index("--") if "--" in args else len(args)
    return args[: end + 1] + [f"./{a}" if a.startswith("-") else a for a in args[end + 1 :]]


def _given(args: list[str], *options: str) -> str | None:
    """Returns the first one of some options that is given."""
    return next((name for arg in args if (name := arg.partition("=")[0]) in options), None)


def _packed(args: list[str], only: int | None) -> dict[str, list[int]]:
    """Returns the compressed files among the arguments, with their places: inputs and values of
    options, but of several files of `--each` the one whose place is given."""
    found: dict[str, list[int]] = {}
    inputs = len(args) - (args[0] == "convert")
    for k in range(1, inputs):
        name = _named(args[k])
        is_other = only not in (None, k) and not args[k].startswith("-") and not _is_value(args, k)
        if name.lower().endswith((".gz", ".bz2", ".xz")) and not is_other:
            if pathlib.Path(name).is_file():
                found.setdefault(name, []).append(k)
    return found


def _named(arg: str) -> str:
    """Returns the part of an argument that may name a file."""
    return arg.rpartition("=")[2] if arg.startswith("-") else arg


def _is_value(args: list[str], k: int) -> bool:
    """Returns whether an argument may be the value of the option before it."""
    before = args[k - 1]
    # A short option may have its value in the same word.
    takes = before[:2] == "--" and "=" not in before or before[:1] == "-" and len(before) == 2
    return takes and before not in SWITCHES and not before[1:].isdecimal()


def _refuse(why: str) -> int:
    """Prints an error, and returns its exit code."""
    print(f"error: {why}", file=sys.stderr)
    return 2


def _inputs(args: list[str]) -> list[str]:
    """Returns the arguments of a subcommand that are no options and no values of options."""
    found = [
        args[k]
        for k in range(1, len(args))
        if not args[k].startswith("-") and not _is_value(args, k)
    ]
    # The first argument of `measure` is another subcommand.
    return found[args[0] == "measure" :]


def _run(args: list[str], only: int | None) -> int:
    """Runs a subcommand that reads files, or one of them, whose place among them is given."""
    words = _inputs(args)
    output: list[str] = []
    if args[:1] == ["convert"]:
        if not _given(args, "--frame", "--json"):
            code = convert(args[1:])
            return command(["linkwatch", *args]) if code is None else code
        words, output = words[:-1], words[-1:]
    files = [args[only]] if only else words
    if not _given(args, "--format"):
        files = list(filter(_only_the_package_reads, files))
    if not files:
        return command(["linkwatch", *args])
    if not only:
        files = _read_together(args, files)
        others = [arg for arg in words if arg not in files]
        if others:
            return _refuse(
                f"only the Python package reads {files[0]}, but the command reads {others[0]}: "
                "convert all files to .npz first"
            )
    if option := _given(args, "--bonds", "--counts", "--topic"):
        return _refuse(f"{option} is no option for {files[0]}, which says its curves itself")
    # By an archive, which the command reads.
    with tempfile.TemporaryDirectory(prefix="linkwatch-") as folder:
        archive = str(pathlib.Path(folder) / f"{pathlib.Path(files[-1]).stem}.npz")
        if only:
            args[only] = archive
        else:
            args = [*(arg for arg in args if arg not in [*files, *output]), archive]
        options, others = _options_of_readers(args)
        are_runs = args[0] == "check" and "--one-motion" not in args
        if convert([*files, *options, archive], says_parts=False, are_runs=are_runs) == 2:
            return 2
        # If the curves change, the frames from there on are in further archives.
        more = len(os.listdir(folder)) - 1
        if more and only:
            return _refuse("the curves change: check the file without --each")
        if more:
            others += [f"{archive[:-4]}-{k + 2}.npz" for k in range(more)]
            others = _those_with_the_frame(others, archive)
            if args[0] in ("check", "convert"):
                wanted = {"--one-motion", "--keep-order"}
                others[1:1] = sorted(wanted - set(others))
        code = command(["linkwatch", *others, *output])
        if code == 2 and more and output[-1:] and not _given(args, "--frame"):
            if output[-1].lower().endswith(".npz"):
                print(
                    "the curves or names change: convert without --json, which writes further "
                    "files, or give --frame",
                    file=sys.stderr,
                )
        return code


def _those_with_the_frame(args: list[str], first: str) -> list[str]:
    """Returns arguments without the archives, from the first one on, that lack the frame of
    ``--frame``."""
    k = next((k for k, arg in enumerate(args) if arg.startswith("--frame")), None)
    if k is None:
        return args
    import numpy as np

    frame = args[k].partition("=")[2] or args[k + 1]
    at = args.index(first)
    archives = [(path, np.load(path)["seq"]) for path in args[at:]]
    low, _, high = frame.partition("..")
    if frame == "last":
        archives = archives[-1:]
    elif low.isdecimal():
        within = range(int(low), int(high if high.isdecimal() else low) + 1)
        having = [one for one in archives if any(k in within for k in one[1].tolist())]
        archives = having or archives
    return [*args[:at], *(path for path, _ in archives)]


def _options_of_readers(args: list[str]) -> tuple[list[str], list[str]]:
    """Splits arguments into the options of :func:`convert` and all others."""
    options, others = [], []
    words = iter(args)
    for word in words:
        name, _, value = word.partition("=")
        if name in FLAGS:
            options.append(word)
            if word == "--closed=false" and "--keep-open" not in args:
                others.append("--keep-open")
            elif word == "--wrapped=false":
                others.append(word)
        elif word in ("--keep-open", "--keep-order", "-q", "--quiet"):
            options.append(word)
            others.append(word)
        elif name in ("--select", "--format", "--cell"):
            options.append(word if value else f"{name}={next(words, '')}")
        else:
            others.append(word)
    return options, others


def _read_together(args: list[str], files: list[str]) -> list[str]:
    """Adds to files of molecules those beside them in the arguments, such as a topology that the
    command itself could read."""
    from . import io

    kinds = {io.format_of(pathlib.Path(file)).name for file in files}
    if not kinds & {"mdanalysis", "oxdna"}:
        return files

    def is_file(k: int) -> bool:
        if k >= len(args) or args[k].startswith("-"):
            return False
        return not _is_value(args, k) and pathlib.Path(args[k]).is_file()

    first, last = args.index(files[0]), args.index(files[-1])
    while first > 1 and is_file(first - 1):
        first -= 1
    while is_file(last + 1):
        last += 1
    return [args[k] for k in range(first, last + 1) if args[k] in files or is_file(k)]


def _only_the_package_reads(arg: str) -> bool:
    """Returns whether this package, but not the command itself, reads the file."""
    if arg.startswith("-") or arg.lower().endswith(OWN):
        return False
    from . import io

    path = pathlib.Path(arg)
    try:
        return path.is_file() and io.format_of(path) is not io.FORMATS[-1]
    except OSError:
        return False


def convert(args: list[str], *, says_parts: bool = True, are_runs: bool = False) -> int | None:
    """Converts files that only this package reads to ``.npz``, and returns the exit code.
    ``says_parts`` says how to check several files that were written. ``are_runs`` refuses files
    with several frames each, which may be runs of their own.

    Returns ``None`` if no argument is such a file: the command itself converts all others.
    """
    chosen = any(arg.startswith("--format") for arg in args)
    if not chosen and not any(map(_only_the_package_reads, _inputs(["convert", *args])[:-1])):
        return None
    import argparse

    from . import io

    formats = " ".join(one.suffixes for one in io.FORMATS)
    parser = argparse.ArgumentParser(
        "linkwatch convert",
        description=f"Converts files to .npz: coils.* {formats}",
        allow_abbrev=False,
    )
    parser.add_argument("input", metavar="IN", nargs="+", help="files of one motion")
    parser.add_argument("output", metavar="OUT.npz")
    parser.add_argument("--force", action="store_true", help="overwrite existing files")
    kept = "keep curves open that only end where they start"
    parser.add_argument("--keep-open", action="store_true", help=kept)
    parser.add_argument("--keep-order", action="store_true", help="keep the order of the files")
    parser.add_argument("-q", "--quiet", action="store_true", help="print warnings and errors only")
    parser.add_argument("--frame", metavar="SEQ", help="convert only the frame with this number")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    # Without an effect here.
    parser.add_argument("-v", "--verbose", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--threads", help=argparse.SUPPRESS)
    for option, what in FLAGS.items():
        parser.add_argument(option, choices=("true", "false"), help=what)
    parser.add_argument("--cell", help="periodic cell: 10,10,12; or none")
    parser.add_argument("--select", help="atoms of molecules to read: 'name CA'")
    parser.add_argument("--format", choices=[one.name for one in io.FORMATS])
    given = parser.parse_intermixed_args([f"{a}=true" if a in FLAGS else a for a in args])
    truth = {"true": True, "false": False, None: None}
    try:
        frames = io.read(
            *given.input,
            closed=truth[given.closed],
            keep_open=given.keep_open,
            keep_order=given.keep_order,
            unwrap=truth[given.wrapped],
            cell=given.cell,
            select=given.select,
            format=given.format,
        )
        if are_runs and frames.runs > 1:
            raise ValueError(
                f"{frames.runs} files have several frames each: check each of them alone (--each), "
                "or give --one-motion if they continue one another"
            )
        written = io.write(frames, given.output, force=given.force)
    except (ImportError, OSError, ValueError) as why:
        return _refuse(str(why))
    summary = frames.summary
    is_whole = not summary.left_out and not summary.rejected
    if not (given.quiet and is_whole):
        print(f"{', '.join(given.input)}: {summary}", file=sys.stderr)
    if len(written) > 1 and says_parts:
        names = " ".join(map(str, written))
        print(
            f"the curves or names change, so there are {len(written)} files: check them with "
            f"`linkwatch check {names} --one-motion`",
            file=sys.stderr,
        )
    return 0 if is_whole else 3
