"""Synthetic homes: drawn from a seed, rendered by ray casting, written as AVD scenes."""
