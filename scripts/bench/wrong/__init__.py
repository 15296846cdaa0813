"""Wrong lidar files: alterations, and how the program responds to them."""
