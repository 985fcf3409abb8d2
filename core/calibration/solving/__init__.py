"""Cameras, clocks and the wand solved from what the views show of it."""
