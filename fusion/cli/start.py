"""The first lines of the program: what must hold before anything else is imported."""

import os
import signal

from fusion.runtime.processes import leave_at_once

if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    # Imports take a while, and nothing is begun that could be left half done. Here and not in
    # `main`, so that little time is left before it.
    signal.signal(signal.SIGINT, leave_at_once)


def main() -> None:
    """Run the command line; the entry point of the installation."""
    if "SPCOLA_LIMITS" in os.environ:
        from fusion.runtime.processes import keep_limits

        keep_limits()
    from fusion.cli.app import main as program

    program()
