"""Files of SPC: the only place where kilometres, degrees and byte orders live."""
