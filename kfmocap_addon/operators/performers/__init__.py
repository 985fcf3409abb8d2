"""Tools for the performers: their bodies, who is who, and what they hold."""
