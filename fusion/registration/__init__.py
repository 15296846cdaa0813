"""Registration of lidar to SPC: by mapolas, returns, images or clouds; the fit; its acceptance."""
