"""Readers and writers of SPC files: the only place where kilometres and degrees live."""
