"""Predicting the motion of parts that no camera sees."""
