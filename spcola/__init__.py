"""The core of stereophotoclinometry: maplets, images, landmarks, shapes, heights, bigmaps.

Everything here uses images and maplets only. Inside the program lengths are metres, angles
radians and times seconds (ephemeris time, TDB past J2000); only the readers and writers in
:mod:`spcola.formats` use kilometres and degrees.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

__version__ = "0.1.0"
