"""Measurements of the tracker's errors and times, and studies of single parts."""
