"""Feet and hands kept in place."""
