"""Tools for cameras: files of them, and calibrations."""
