"""2D keypoints of other programs' detectors: whose they are, and poses made of them."""
