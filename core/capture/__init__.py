"""Captures of an L-frame and a wand, from which cameras are calibrated."""
