"""Checks of cameras and footage against key poses, and what they find."""
