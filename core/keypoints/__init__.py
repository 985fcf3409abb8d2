"""2D keypoints from pose detectors: assigned to performers, and turned into poses."""
