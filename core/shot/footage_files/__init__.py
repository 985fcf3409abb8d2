"""Files of footage: videos and image sequences, checked before they are decoded."""
