"""States of images from SPICE kernels."""

from spcola.spice.states.reading import Correction, SpiceCamera, body_rate, spice_states

__all__ = ["Correction", "SpiceCamera", "body_rate", "spice_states"]
