"""Registration of mapolas to SPC surfaces: the match of each one, and the fit to all."""
