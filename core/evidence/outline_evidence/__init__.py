"""What the performers' outlines in the images say of the poses."""
