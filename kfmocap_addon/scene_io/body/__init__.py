"""A body as an armature with parts: its shape, its pose, and how it is drawn."""
