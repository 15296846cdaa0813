"""Scale, centre and prime meridian from paired bigmaps and single shots."""
