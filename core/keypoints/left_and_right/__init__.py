"""Left and right of keypoints, which detectors confuse."""
