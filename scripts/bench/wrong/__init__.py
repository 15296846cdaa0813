"""Ways in which lidar files can be wrong: what they alter, and what the program makes of them."""
