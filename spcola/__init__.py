"""The core of stereophotoclinometry: maplets, images, landmarks, shapes, heights, bigmaps.

Everything here uses images and maplets only. Inside the program lengths are metres, angles
radians and times seconds (ephemeris time, TDB past J2000); only the readers and writers in
:mod:`spcola.formats` use kilometres and degrees.
"""

__version__ = "0.1.0"
