"""Keyframe tracking without Blender: footage to evidence to solver to motion."""
