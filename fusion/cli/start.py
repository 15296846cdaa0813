"""Start of the program: interrupts and limits, before anything else is imported."""

import os
import signal

from fusion.runtime.processes import leave_at_once

if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    # An interrupt during the imports, which take a while, needs no clean-up. Set here and not in
    # `main`, to be early.
    signal.signal(signal.SIGINT, leave_at_once)


def main() -> None:
    """Run the command line; the entry point of the installation."""
    if "SPCOLA_LIMITS" in os.environ:
        from fusion.runtime.processes import apply_limits

        apply_limits()
    from fusion.cli.app import main as program

    program()
