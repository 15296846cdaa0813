"""Mutated files of every format that the program reads: refused in one line, or read.

Each input is one good small file (`fuzz_samples.py`), mutated (`fuzz_mutations.py`) by a random
generator that is seeded by seed, kind and number, so that any input can be made again. A child
process reads them one by one with a limit on processor time and on memory; if it dies, the input
that killed it is counted and another child continues after it.

`refused`: an error of one line. `accepted`: read, whatever the numbers. `unexpected`: any other
exception, a warning, or more memory than allowed. `aborts`: the process died. `hangs`: it took
longer than the limit. The last three should be 0; each is printed with its number to reproduce it.

    python scripts/bench/fuzz.py [--inputs 1000] [--seed 0] [--kind laz] [--only 17 --keep FILE]
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from fuzz_mutations import mutated
from fuzz_samples import KINDS, Sample

from spcola.errors import SpcolaError

LIMIT_S = 5.0
"""Processor time for one input; a good one takes a few milliseconds."""
LIMIT_BYTES = 1 << 30
"""Address space for one input, in addition to that of the program."""
_SILENT_S = 120.0
OUTCOMES = ("refused", "accepted", "unexpected", "aborts", "hangs")


@dataclass
class Tally:
    """Outcomes of the inputs of one kind; `failures` are the numbers of inputs by message."""

    counts: Counter[str] = field(default_factory=Counter)
    failures: dict[str, list[int]] = field(default_factory=dict)

    def add(self, number: int, outcome: str, text: str = "") -> None:
        """Count one input."""
        self.counts[outcome] += 1
        if outcome in OUTCOMES[2:]:
            self.failures.setdefault(f"{outcome}: {text}", []).append(number)


def input_of(sample: Sample, good: bytes, kind: str, seed: int, number: int) -> bytes:
    """Return one mutated input."""
    return mutated(good, sample.form, random.Random(f"{seed} {kind} {number}"))


def outcome_of(sample: Sample, path: Path) -> tuple[str, str]:
    """Read a file; return the outcome, and the message if it is a failure."""
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            sample.read(path)
    except SpcolaError as error:
        in_one_line = str(error).encode("utf-8", errors="strict").count(b"\n") == 0
        return ("refused", "") if in_one_line else ("unexpected", "an error of many lines")
    except BaseException as error:  # a PanicException is none of Exception
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if "site-packages" not in frame.filename][-1]
        where = f"{Path(own.filename).name}:{own.lineno}, {frames[-1].name}"
        return "unexpected", f"{type(error).__name__} at {where}: {str(error)[:80]!r}"
    if caught:
        first = caught[0]
        return "unexpected", f"warning {first.category.__name__}: {str(first.message)[:80]!r}"
    return "accepted", ""


def read_all(kind: str, numbers: range, seed: int, *, child: bool = True) -> Tally:
    """Read mutated inputs of one kind; in child processes, or in this one."""
    sample, tally = KINDS[kind], Tally()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        path = _made(sample, Path(folder), fork=child and sample.threads)
        good = path.read_bytes()
        if not child:
            for number in numbers:
                path.write_bytes(input_of(sample, good, kind, seed, number))
                tally.add(number, *outcome_of(sample, path))
            return tally
        todo = numbers
        while todo:
            todo = todo[_child(kind, todo, seed, path, good, tally) :]
    return tally


def _made(sample: Sample, folder: Path, *, fork: bool) -> Path:
    """Make the good file, and read it, so that first imports do not count as an input's time."""
    if not fork:
        path = sample.make(folder)
        sample.read(path)
        return path
    pid = os.fork()
    if pid == 0:
        try:
            sample.make(folder)
        finally:
            os._exit(0)
    os.waitpid(pid, 0)
    return next(folder.iterdir())


def _child(kind: str, todo: range, seed: int, path: Path, good: bytes, tally: Tally) -> int:
    """Read inputs in a child process until it ends or dies; return how many are done with."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(reading)
        try:
            _work(kind, todo, seed, path, good, writing)
        finally:
            os._exit(1)
    os.close(writing)
    done, rest, silent = 0, b"", False
    while True:
        if not select.select([reading], [], [], _SILENT_S)[0]:
            silent = True
            os.kill(pid, signal.SIGKILL)
        block = os.read(reading, 1 << 16)
        if not block:
            break
        *lines, rest = (rest + block).split(b"\n")
        for line in lines:
            outcome, _, text = line.decode().partition(" ")
            tally.add(todo[done], outcome, text)
            done += 1
    os.close(reading)
    status = os.waitpid(pid, 0)[1]
    if done == len(todo):
        return done
    number = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    hung = silent or number == signal.SIGPROF
    tally.add(todo[done], "hangs" if hung else "aborts", f"status {status}, signal {number}")
    return done + 1


def _work(kind: str, todo: range, seed: int, path: Path, good: bytes, writing: int) -> None:
    """Run in the child: read inputs, and write one line for each."""
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 2)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * os.sysconf("SC_PAGE_SIZE") + LIMIT_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    sample = KINDS[kind]
    for number in todo:
        path.unlink(missing_ok=True)
        path.write_bytes(input_of(sample, good, kind, seed, number))
        # The default action ends the process, wherever it is: in Python or in a library.
        signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
        outcome, text = outcome_of(sample, path)
        signal.setitimer(signal.ITIMER_PROF, 0)
        os.write(writing, f"{outcome} {' '.join(text.split())}\n".encode(errors="replace"))
    os._exit(0)


def main() -> int:
    """Read the inputs, print the table and the failures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--inputs", type=int, default=1000, help="of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", action="append", choices=list(KINDS), help="all if not given")
    parser.add_argument("--only", type=int, help="number of one input, read in this process")
    parser.add_argument("--keep", type=Path, help="where to write the one input")
    wanted = parser.parse_args()
    kinds = wanted.kind or list(KINDS)
    if wanted.only is not None:
        return _one(kinds[0], wanted.seed, wanted.only, wanted.keep)
    print(f"{'kind':18}{'inputs':>9}" + "".join(f"{name:>12}" for name in OUTCOMES) + "  ms each")
    bad = 0
    for kind in kinds:
        begun = time.perf_counter()
        tally = read_all(kind, range(wanted.inputs), wanted.seed)
        each = 1e3 * (time.perf_counter() - begun) / wanted.inputs
        columns = "".join(f"{tally.counts[name]:12d}" for name in OUTCOMES)
        print(f"{kind:18}{wanted.inputs:9d}{columns}{each:9.2f}", flush=True)
        for text, numbers in sorted(tally.failures.items(), key=lambda item: -len(item[1])):
            print(f"    {len(numbers)} x {text} (--only {numbers[0]})", flush=True)
            bad += len(numbers)
    return int(bad > 0)


def _one(kind: str, seed: int, number: int, keep: Path | None) -> int:
    """Read one input in this process and print the outcome."""
    sample = KINDS[kind]
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    path = sample.make(folder)
    path.write_bytes(input_of(sample, path.read_bytes(), kind, seed, number))
    if keep is not None:
        shutil.copyfile(path, keep)
    sample.read(path)
    shutil.rmtree(folder)
    print("accepted")
    return 0


if __name__ == "__main__":
    sys.exit(main())
