"""Tools that take the motion elsewhere: to files, and to other characters."""
