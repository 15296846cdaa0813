"""The global scale of an SPC solution from lidar ranges: paired bigmaps and single shots."""
