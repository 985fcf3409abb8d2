"""Tracking again without pictures that the result shows to be damaged, and with the gaps that it shows."""
