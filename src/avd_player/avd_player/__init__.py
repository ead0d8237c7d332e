"""Homes to look around in: AVD scenes, RGB-D sequences, synthetic homes, and moving in them."""
