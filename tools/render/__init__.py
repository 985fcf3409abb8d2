"""Synthetic footage with exact ground truth: motions, a skinned figure, a room, and the video files."""
