"""What is drawn over the footage."""
