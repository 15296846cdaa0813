"""Ways in which lidar files can be wrong, and what the program makes of them."""
