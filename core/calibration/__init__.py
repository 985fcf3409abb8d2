"""Cameras from an L-frame on the floor and a waved wand, or from a performer."""
