"""What is calibrated from: the capture of an L-frame and a wand."""
