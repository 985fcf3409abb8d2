"""Fingers: hand shapes, and motion from tracked points."""
