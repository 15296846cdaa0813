"""Files of SPC: the only place with kilometres, degrees and byte orders."""
