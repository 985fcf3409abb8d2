"""Poses and keys that the tools make."""
