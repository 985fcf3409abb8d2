"""Calibrations of cameras, in the formats of every program that is read or written."""
