"""Searching homes for a thing: the loop, and who decides in it."""
