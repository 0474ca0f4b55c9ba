"""Reads mutated files by the command line in one process and says what came of it, as JSON.

    python mutated_files.py SEED COUNT FOLDER

FOLDER holds one folder for each kind of file: `argument` says how the command gets it, the other files are mutated, one
at a time. The parent sets the bounds; this process only measures: peak memory, the slowest file, and every file that
did not end in exit code 0, or 2 with one line. Before that, each kind is read unharmed.
"""

from __future__ import annotations

import contextlib
import gzip
import io
import json
import random
import sys
import time
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from peak_memory import peak_of_this_process_mb
from uwcoop.cli import app

EXTREMES = [
    b"\x00",
    b"\xff",
    b"\x7f",
    b"\xff" * 4,
    b"\xff\xff\xff\x7f",
    b"\xff" * 8,
    b"\0\0\0\x80",
    b"\n",
    b"9" * 9,
]
"""What lengths, counts and digits turn into."""


def mutated(content: bytes, rng: random.Random) -> bytes:
    """The content with one to several changes of the kinds that damage and malice make."""
    changed = bytearray(content)
    for _ in range(rng.choice([1, 1, 1, 2, 5, 20])):
        at, length = rng.randrange(len(changed) + 1), rng.choice([1, 2, 4, 8, 64, 1000])
        kind = rng.randrange(8)
        if kind == 0 and changed:
            changed[at % len(changed)] ^= 1 << rng.randrange(8)
        elif kind == 1:
            changed[at : at + length] = rng.randbytes(length)
        elif kind == 2:
            extreme = rng.choice(EXTREMES)
            changed[at : at + len(extreme)] = extreme
        elif kind == 3:
            del changed[at : at + length]
        elif kind == 4:
            changed[at:at] = changed[at : at + length] * rng.choice([1, 2, 50])
        elif kind == 5:
            del changed[at:]
        elif kind == 6:
            other = rng.randrange(len(changed) + 1)
            changed[at : at + length] = changed[other : other + length]
        else:
            digits = [k for k, byte in enumerate(changed[:100_000]) if 48 <= byte <= 57]
            if digits:
                changed[rng.choice(digits)] = rng.choice(b"0123456789-.eEnN")
    return bytes(changed)


def repacked(content: bytes, rng: random.Random) -> bytes:
    """Damage inside what is compressed, half of the time; else to the file as it is."""
    if content[:2] == b"\x1f\x8b" and rng.random() < 0.5:
        return gzip.compress(mutated(gzip.decompress(content), rng), 1)
    return mutated(content, rng)


def outcome(arguments: list[str]) -> tuple[int, list[str], str]:
    """Exit code, lines on stderr, and the traceback if there is one."""
    err, trace, code = io.StringIO(), "", 0
    with contextlib.redirect_stderr(err), contextlib.redirect_stdout(io.StringIO()):
        try:
            app(arguments)
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        except BaseException:
            code, trace = 1, traceback.format_exc()
    return code, err.getvalue().splitlines(), trace


def kinds(folder: Path) -> Iterator[tuple[list[str], Path, list[tuple[Path, bytes]]]]:
    for kind in sorted(folder.iterdir()):
        arguments = json.loads((kind / "argument").read_text())
        files = [path for path in sorted(kind.iterdir()) if path.name != "argument"]
        yield arguments, kind, [(path, path.read_bytes()) for path in files]


def main(seed: int, count: int, folder: Path) -> dict[str, Any]:
    rng = random.Random(seed)
    every = list(kinds(folder))
    told: dict[str, Any] = {
        "refused": 0,
        "read": 0,
        "slowest_s": 0.0,
        "bad": [],
        "slowest": "",
        "unharmed": {},
    }
    for arguments, kind, _ in every:
        code, lines, trace = outcome(arguments)
        told["unharmed"][kind.name] = [code, *lines, trace][: 1 if code == 0 else 5]
    for number in range(count):
        arguments, kind, files = every[number % len(every)]
        path, content = rng.choice(files)
        path.write_bytes(repacked(content, rng))
        start = time.process_time()
        code, lines, trace = outcome(arguments)
        seconds = time.process_time() - start
        if seconds > told["slowest_s"]:
            told |= {"slowest_s": seconds, "slowest": f"{kind.name} {number}"}
        told["refused" if code else "read"] += 1
        if code not in (0, 2) or (code == 2 and len(lines) != 1):
            kept = folder.parent / f"bad-{seed}-{number}-{path.name}"
            kept.write_bytes(path.read_bytes())
            told["bad"].append([kind.name, number, code, lines[:5], trace[-1500:]])
        path.write_bytes(content)
    return told | {"peak_mb": peak_of_this_process_mb()}


if __name__ == "__main__":
    print(json.dumps(main(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]))))
