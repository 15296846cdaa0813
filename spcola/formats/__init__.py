"""Files of SPC, shapes, images and stores; the only place in spcola with km and degrees."""
