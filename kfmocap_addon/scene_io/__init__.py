"""Blender data as core values, and back."""
