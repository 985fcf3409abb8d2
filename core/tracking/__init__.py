"""Tracking: from evidence and key poses to motion."""
