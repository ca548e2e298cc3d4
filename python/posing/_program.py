"""Finds the program ``posing`` and runs it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple


class PosingError(Exception):
    """The program refused; the text is the program's line.

    A flag ``--max-gap`` in the line is the keyword ``max_gap``.

    Attributes
    ----------
    code : int
        Exit code: 1, the data; 2, the call; below 0, the signal.
    notes : list of str
        Lines that the program printed before.
    stdout : bytes
        What the program wrote all the same.
    """

    # The defaults let multiprocessing pass it on.
    def __init__(
        self, line: str, code: int = 1, notes: Sequence[str] = (), stdout: bytes = b""
    ) -> None:
        super().__init__(line)
        self.code = code
        self.notes = list(notes)
        self.stdout = stdout


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
        raise PosingError(f"no program posing in {where}; install the wheel again")
    return found


def run(*arguments: str | os.PathLike[str], input: bytes | None = None) -> Finished:
    """Run any command of the program, without a shell.

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
    """
    command = [program(), *(os.fspath(argument) for argument in arguments)]
    done = subprocess.run(command, input=input or b"", capture_output=True, check=False)
    lines = done.stderr.decode(errors="replace").splitlines()
    if done.returncode in (0, 3):
        return Finished(done.stdout, lines, done.returncode)
    line = lines.pop() if lines else f"posing ended with code {done.returncode} and said nothing"
    if done.returncode == 2 and "unexpected argument" in line:
        raise TypeError(line)
    raise PosingError(line, done.returncode, lines, done.stdout)


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
        if isinstance(value, (list, tuple)):
            value = ",".join(map(str, value))
        if value is True:
            given.append(flag)
        elif value is not None and value is not False:
            given.append(f"{flag}={value}")
    return given
