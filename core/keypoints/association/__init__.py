"""Which detections show which person: over time, across views, and among the performers."""
