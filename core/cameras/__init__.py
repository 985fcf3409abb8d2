"""Cameras and their lenses."""
