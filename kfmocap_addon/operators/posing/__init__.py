"""Tools that make key poses."""
