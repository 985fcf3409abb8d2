"""What the brightness of pixels says of the motion from one frame to the next."""
