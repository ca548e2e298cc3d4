"""Finds the program ``posing`` and runs it."""

from __future__ import annotations

import errno
import functools
import json
import keyword
import os
import re
import shutil
import subprocess
import sysconfig
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple


class PosingError(Exception):
    """The program refused; the text is the program's line. Also called ``posing.Error``.

    Most errors are one of Python's own classes, too: `ValueError`, what was given
    cannot be used; `FileNotFoundError`, a file is not there; `OSError`, another
    failure of reading or writing. The line of a function speaks of keywords
    (``fps=120``), that of `run` of flags (``--fps 120``).

    Attributes
    ----------
    code : int
        Exit code: 1, the data; 2, the call; below 0, the signal.
    notes : list of str
        Lines that the program printed before.
    stdout : bytes
        What the program wrote all the same.

    Examples
    --------
    >>> try:
    ...     take = posing.read("gait.c3d")
    ... except FileNotFoundError as error:
    ...     print(error.filename)
    gait.c3d
    """

    # The defaults let multiprocessing pass it on.
    def __init__(
        self, line: str, code: int = 1, notes: Sequence[str] = (), stdout: bytes = b""
    ) -> None:
        super().__init__(line)
        self.code = code
        self.notes = list(notes)
        self.stdout = stdout


class DataError(PosingError, ValueError):
    """What was given cannot be used."""


class FileError(PosingError, OSError):
    """A file cannot be read or written; ``filename`` and ``errno`` say which and why."""

    # Those of OSError would be lost between processes, and change the text.
    filename: Any = None
    errno: Any = None
    strerror: Any = None


class MissingFileError(FileError, FileNotFoundError):
    """A file is not there."""


def _refusal(line: str, code: int, notes: Sequence[str], stdout: bytes) -> PosingError:
    """The error of the class that a line of the program is of."""
    failed = re.match(r"(?:[\w-]+: )?(.*?): [^:]*\(os error (\d+)\)", line)
    if failed:
        number = int(failed[2])
        kind = MissingFileError if number == errno.ENOENT else FileError
        error = kind(line, code, notes, stdout)
        error.filename, error.errno, error.strerror = failed[1], number, os.strerror(number)
        return error
    return (DataError if code in (1, 2) else PosingError)(line, code, notes, stdout)


class Finished(NamedTuple):
    """What a command wrote, its lines on standard error, and 0 or 3 (findings)."""

    stdout: bytes
    notes: list[str]
    code: int


def program() -> str:
    """Path of the program.

    ``POSING_BIN``, a file or a folder, goes first; then the folders into which
    wheels install programs; then ``PATH``.

    Raises
    ------
    PosingError
        There is none.
    """
    name = "posing.exe" if os.name == "nt" else "posing"
    chosen = os.environ.get("POSING_BIN")
    if chosen:
        places = [Path(chosen), Path(chosen, name)]
    else:
        places = [
            Path(sysconfig.get_path("scripts"), name),
            Path(sysconfig.get_path("scripts", f"{os.name}_user"), name),
            Path(__file__).parents[1] / "bin" / name,  # pip install --target
        ]
    for place in places:
        if place.is_file():
            return str(place)
    found = None if chosen else shutil.which(name)
    if found is None:
        where = f"POSING_BIN={chosen}" if chosen else f"{places[0].parent} or on PATH"
        error = MissingFileError(f"no program posing in {where}; install the wheel again")
        error.filename = chosen or name
        raise error
    return found


def run(*arguments: str | os.PathLike[str], input: bytes | None = None) -> Finished:
    """Run any command of the program, without a shell.

    On Linux the program ends with the interpreter, however that one ends.

    Parameters
    ----------
    *arguments : str or path
        The command and its arguments: ``"plot", "-o", "walk.html", "walk.csv"``.
    input : bytes, optional
        Standard input; empty if not given.

    Raises
    ------
    PosingError
        The exit code is neither 0 nor 3.
    TypeError
        The command has no such flag; the text names a similar one.

    Examples
    --------
    >>> posing.run("trim", "--from=1", "--to=csv", "walk.csv").stdout.decode()
    """
    return _run(arguments, input, str)


def call(
    *arguments: str | os.PathLike[str], input: bytes | None = None, folder: object = None
) -> Finished:
    """As `run`, but lines speak of keywords, and not of the temporary folder."""
    hidden = f"{folder}{os.sep}" if folder else ""
    return _run(arguments, input, lambda line: in_python(line.replace(hidden, "")))


def _run(
    arguments: Sequence[str | os.PathLike[str]], input: bytes | None, say: Callable[[str], str]
) -> Finished:
    command = [program(), *(os.fspath(argument) for argument in arguments)]
    environment = {**os.environ, "POSING_PARENT": str(os.getpid())}
    done = subprocess.run(
        command, input=input or b"", capture_output=True, check=False, env=environment
    )
    lines = [say(line) for line in done.stderr.decode(errors="replace").splitlines()]
    if done.returncode in (0, 3):
        return Finished(done.stdout, lines, done.returncode)
    line = lines.pop() if lines else f"posing ended with code {done.returncode} and said nothing"
    if done.returncode == 2 and "unexpected argument" in line:
        raise TypeError(line)
    raise _refusal(line, done.returncode, lines, done.stdout)


# A flag, its placeholder in a line of clap's, and a value where what follows can be nothing else.
_FLAG = re.compile(
    r"(?<![\w./-])--(?P<name>[a-z](?:[a-z-]*[a-z])?)(?![\w/-]|\.\w)"
    r"(?: <[^>]*>|[= ](?P<value>(?:-?\d[\d.]*\d|\d|-?[xyz]|cm|mm|m|asf|auto|none|[A-Z][\w.|]*\w)"
    r"(?![\w./])))?"
)


def in_python(line: str) -> str:
    """A line of the program with keywords in place of flags.

    >>> in_python("give it with --units mm, or --max-gap; or use --self")
    'give it with units="mm", or max_gap; or use self=True'
    """

    def word(flag: re.Match[str]) -> str:
        name, value = flag["name"].replace("-", "_"), flag["value"]
        name += "_" * keyword.iskeyword(name)
        if value is None:
            return name + "=True" * (flag["name"] in _switches())
        return f'{name}="{value}"' if re.fullmatch("-?[a-z]+", value) else f"{name}={value}"

    return _FLAG.sub(word, re.sub(r"; see posing [\w-]+ --help$", "", line))


@functools.lru_cache(maxsize=None)
def _switches() -> frozenset[str]:
    """The flags that take no value."""
    usage = json.loads(subprocess.check_output([program(), "--json-usage"]))
    arguments = [a for command in usage["commands"] for a in command["arguments"] if a["flag"]]
    return frozenset(a["flag"][2:] for a in arguments if a["type"] == "switch")


# The flags that are given again for each value; values of others are joined by commas.
ONE_BY_ONE = {"exchange", "keep_labels", "like", "parameter", "redo", "truth"}


def flags(**options: Any) -> list[str]:
    """Keywords as flags of the program.

    None and False are left out, True is a switch, items of a list or a dict are
    joined by commas, and an underscore at the end is dropped (``from_``).
    """
    given = []
    for name, value in options.items():
        flag = "--" + name.rstrip("_").replace("_", "-")
        if hasattr(value, "tolist"):  # NumPy's scalars and arrays, pandas' indexes
            value = value.tolist()
        if isinstance(value, dict):
            value = [f"{key}={of}" for key, of in value.items()]
        if isinstance(value, (list, tuple)) and name in ONE_BY_ONE:
            given += [f"{flag}={item}" for item in value]
            continue
        if isinstance(value, (list, tuple)):
            value = ",".join(map(str, value))
        if value is True:
            given.append(flag)
        elif value is not None and value is not False:
            given.append(f"{flag}={value}")
    return given
