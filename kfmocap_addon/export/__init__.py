"""Files for other programs, written by Blender."""
