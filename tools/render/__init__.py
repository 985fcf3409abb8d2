"""Rendering of made footage with exact truth: motions, a skinned figure, a room, and the video files."""
