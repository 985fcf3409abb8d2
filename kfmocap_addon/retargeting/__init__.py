"""Retargeting in Blender: reading a rig's controls, writing their curves, and measuring the result."""
