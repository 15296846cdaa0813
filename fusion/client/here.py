"""Does the steps of calls on a local folder, in this process."""

from __future__ import annotations

import asyncio
import time
from typing import Any

from fusion.client.steps import Compute, Effect, Pause


class HereDoing:
    """Does the effects of one call; there is nothing to send."""

    def perform(self, effect: Effect) -> Any:
        """Do an effect and return its outcome."""
        if isinstance(effect, Pause):
            return time.sleep(effect.seconds)
        assert isinstance(effect, Compute)
        return effect.function()

    def close(self) -> None:
        """Close nothing."""


class HereDoingAsync:
    """Does the effects of one call in a thread, while others go on."""

    async def perform(self, effect: Effect) -> Any:
        """Do an effect and return its outcome."""
        if isinstance(effect, Pause):
            return await asyncio.sleep(effect.seconds)
        assert isinstance(effect, Compute)
        return await asyncio.to_thread(effect.function)

    async def close(self) -> None:
        """Close nothing."""
