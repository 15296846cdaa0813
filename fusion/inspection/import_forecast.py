"""Forecast of time and memory for the import of a lidar file, measured on this machine.

Measured on files of 4 and 8 million returns, while other jobs shared the machine, against imports
by one worker without the start of the program: OLA 7.2 s forecast, 8 to 9 s taken; LAS 8.5 and 8;
LAZ 17 and 22; a table 5.6 and 6.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fusion.pipeline.catalog import file_digest
from fusion.runtime.machine import PROGRAM_BYTES
from fusion.workspace.settings.inputs import ImportSettings
from lidar.formats.native import write_scan
from lidar.scans import Scan
from spcola.errors import SpcolaError

BYTES_PER_RETURN = 525
"""Memory of one return of a chunk while it is read, screened, sorted and packed.

Measured on OLA tables: peaks of one worker and of two were 0.35 and 0.46 GB at chunks of 200,000
returns, 0.77 and 1.30 GB at a million, of which the program takes 0.25 GB.
"""
# Returns that are packed to time one; fewer before that, while code is compiled.
_SAMPLE, _FIRST = 200_000, 1000


@dataclass
class ImportClock:
    """Times the reading of a file chunk by chunk, and then the packing of a sample of it.

    Parameters
    ----------
    now : callable
        Returns the time, s.
    """

    now: Callable[[], float] = time.perf_counter
    returns: int = field(default=0, init=False)
    reading_s: float = field(default=0.0, init=False)
    _sample: Scan | None = field(default=None, init=False)

    def timed(self, chunks: Iterator[Scan]) -> Iterator[Scan]:
        """Yield the chunks of a file; what the caller does with them is not timed."""
        while True:
            begun = self.now()
            scan = next(chunks, None)
            self.reading_s += self.now() - begun
            if scan is None:
                return
            if len(scan) and self._sample is None:
                self._sample = scan.select(np.arange(min(len(scan), _SAMPLE)))
            self.returns += len(scan)
            yield scan

    def forecast(self, path: Path) -> dict[str, Any]:
        """Return the forecast for one worker of importing `path`, whose chunks were timed.

        Without the start of the program. ``import_s`` is None if no sample can be written.
        """
        chunk = min(self.returns, ImportSettings().chunk)
        taken = (PROGRAM_BYTES + chunk * BYTES_PER_RETURN) / 1e6
        try:
            seconds = self.reading_s + self._packing_s(path.stat().st_size)
        except (OSError, SpcolaError):
            return {"import_s": None, "import_memory_mb": taken}
        return {"import_s": seconds, "import_memory_mb": taken}

    def _packing_s(self, size: int) -> float:
        """Return the time to pack all returns and to digest the scan and its source file, s."""
        if self._sample is None:
            return 0.0
        with tempfile.TemporaryDirectory() as folder:
            packed = Path(folder) / "sample.h5"
            write_scan(packed, [self._sample.select(np.arange(min(len(self._sample), _FIRST)))])
            begun = self.now()
            write_scan(packed, [self._sample])
            written = self.now()
            file_digest(packed)
            per_byte = (self.now() - written) / packed.stat().st_size
            share = self.returns / len(self._sample)
            return share * (written - begun + per_byte * packed.stat().st_size) + per_byte * size
